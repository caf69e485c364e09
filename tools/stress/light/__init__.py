"""The extremes of light."""

from evs.tools.stress.light import bad, levels, pulses, sun

EXTREMES = (*levels.EXTREMES, *sun.EXTREMES, *pulses.EXTREMES, *bad.EXTREMES)

__all__ = ["EXTREMES"]
