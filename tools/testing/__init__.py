"""The pytest plugin: run a controller against a scene, and say what has to hold of the loop.

Names are imported at first use: pytest loads the plugin in every run, also where nobody asks for
it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.tools.testing.evidence import replay
    from evs.tools.testing.pushes import Push
    from evs.tools.testing.run import Run
    from evs.tools.testing.runner import LoopRunner
    from evs.tools.testing.trace import Trace

__all__ = ["LoopRunner", "Push", "Run", "Trace", "replay"]


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
    if name == "replay":
        return import_module("evs.tools.testing.evidence").replay
    raise AttributeError(f"module 'evs.tools.testing' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
