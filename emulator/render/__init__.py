"""Light: renderers behind one protocol."""

from evs.emulator.render.direct import DirectRenderer
from evs.emulator.render.flicker import flicker_warnings
from evs.emulator.render.path import PathRenderer
from evs.emulator.render.selection import make_renderer

__all__ = ["DirectRenderer", "PathRenderer", "flicker_warnings", "make_renderer"]
