"""Light: renderers behind one protocol."""

from evs.emulator.light.choose import make_renderer
from evs.emulator.light.direct import DirectRenderer
from evs.emulator.light.truth import GroundTruth

__all__ = ["DirectRenderer", "GroundTruth", "make_renderer"]
