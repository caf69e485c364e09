"""The pytest plugin: run a controller against a scene, and say what has to hold of the loop.

Names are imported at first use: pytest loads the plugin in every run, also where nobody asks for
it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.drivers.testing.evidence import replay
    from evs.drivers.testing.pushes import Push
    from evs.drivers.testing.run import Run
    from evs.drivers.testing.runner import LoopRunner
    from evs.drivers.testing.trace import Trace

__all__ = ["LoopRunner", "Push", "Run", "Trace", "replay"]


def __getattr__(name: str) -> Any:
    # written out, so that the house's rules see every import
    if name == "LoopRunner":
        return import_module("evs.drivers.testing.runner").LoopRunner
    if name == "Push":
        return import_module("evs.drivers.testing.pushes").Push
    if name == "Run":
        return import_module("evs.drivers.testing.run").Run
    if name == "Trace":
        return import_module("evs.drivers.testing.trace").Trace
    if name == "replay":
        return import_module("evs.drivers.testing.evidence").replay
    raise AttributeError(f"module 'evs.drivers.testing' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
