"""The extremes of light."""

from evs.drivers.extremes.light import bad, levels, pulses, sun

EXTREMES = (*levels.EXTREMES, *sun.EXTREMES, *pulses.EXTREMES, *bad.EXTREMES)

__all__ = ["EXTREMES"]
