"""The extremes of light."""

from evs.drivers.extremes.light import bad, levels, pulses

EXTREMES = (*levels.EXTREMES, *pulses.EXTREMES, *bad.EXTREMES)

__all__ = ["EXTREMES"]
