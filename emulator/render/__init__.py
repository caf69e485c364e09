"""Light: renderers behind one protocol. Names are imported at first use.

A new renderer plugs in at registry.py, which the configuration reads too: no renderer is imported
with this package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from evs.msgs.registry import load

if TYPE_CHECKING:
    from evs.emulator.render.flicker import flicker_warnings
    from evs.emulator.render.native import NativeRenderer
    from evs.emulator.render.selection import make_renderer

_HOMES = {
    "NativeRenderer": "evs.emulator.render.native:NativeRenderer",
    "flicker_warnings": "evs.emulator.render.flicker:flicker_warnings",
    "make_renderer": "evs.emulator.render.selection:make_renderer",
}

__all__ = ["NativeRenderer", "flicker_warnings", "make_renderer"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return load(_HOMES[name])
