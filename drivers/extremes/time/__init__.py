"""The extremes of time."""

from evs.drivers.extremes.time import ticks

EXTREMES = ticks.EXTREMES

__all__ = ["EXTREMES"]
