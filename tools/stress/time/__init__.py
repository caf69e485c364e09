"""The extremes of time."""

from evs.tools.stress.time import day, resets, starts, ticks

EXTREMES = (*ticks.EXTREMES, *day.EXTREMES, *starts.EXTREMES, *resets.EXTREMES)

__all__ = ["EXTREMES"]
