"""Light: renderers behind one protocol."""

from evs.emulator.light.choose import make_renderer
from evs.emulator.light.direct import DirectRenderer

__all__ = ["DirectRenderer", "make_renderer"]
