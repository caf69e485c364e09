"""The pytest plugin: run a controller against a scene, and say what has to hold of the loop.

pytest loads it where it is asked for: `pytest -p evs`, or `from evs.tools.testing import
evs_loop` in a conftest.py. Names are imported at first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.tools.testing.evidence import replay
    from evs.tools.testing.plugin import evs_loop
    from evs.tools.testing.pushes import Push
    from evs.tools.testing.run import Run
    from evs.tools.testing.runner import LoopRunner
    from evs.tools.testing.trace import Trace

__all__ = ["LoopRunner", "Push", "Run", "Trace", "evs_loop", "replay"]


def __getattr__(name: str) -> Any:
    # written out, so that the house's rules see every import
    if name == "LoopRunner":
        return import_module("evs.tools.testing.runner").LoopRunner
    if name == "Push":
        return import_module("evs.tools.testing.pushes").Push
    if name == "Run":
        return import_module("evs.tools.testing.run").Run
    if name == "Trace":
        return import_module("evs.tools.testing.trace").Trace
    if name == "evs_loop":
        return import_module("evs.tools.testing.plugin").evs_loop
    if name == "replay":
        return import_module("evs.tools.testing.evidence").replay
    raise AttributeError(f"module 'evs.tools.testing' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
