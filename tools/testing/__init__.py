"""The pytest plugin: run a controller against a scene, and check claims about the loop.

pytest loads it on request: `pytest -p evs`, or `from evs.tools.testing import
evs_loop` in a conftest.py. Names are imported at first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.tools.testing.evidence import replay
    from evs.tools.testing.plugin import evs_loop
    from evs.tools.testing.pushes import Push
    from evs.tools.testing.run import Run, Trace
    from evs.tools.testing.runner import LoopRunner

__all__ = ["LoopRunner", "Push", "Run", "Trace", "evs_loop", "replay"]


_HOMES = {
    "LoopRunner": "evs.tools.testing.runner:LoopRunner",
    "Push": "evs.tools.testing.pushes:Push",
    "Run": "evs.tools.testing.run:Run",
    "Trace": "evs.tools.testing.run:Trace",
    "evs_loop": "evs.tools.testing.plugin:evs_loop",
    "replay": "evs.tools.testing.evidence:replay",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'evs.tools.testing' has no attribute {name!r}")
    # here, so that loading the plugin imports nothing else of evs
    from evs.msgs.registry import load

    return load(_HOMES[name])


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
