"""The extremes of motion."""

from evs.drivers.extremes.motion import speeds

EXTREMES = speeds.EXTREMES

__all__ = ["EXTREMES"]
