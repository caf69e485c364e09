"""Light: renderers behind one protocol."""

from evs.emulator.light.choose import make_renderer
from evs.emulator.light.direct import DirectRenderer
from evs.emulator.light.flicker import too_fast
from evs.emulator.light.path import PathRenderer

__all__ = ["DirectRenderer", "PathRenderer", "make_renderer", "too_fast"]
