"""Stress cases of time."""

from evs.tools.stress.time import day, resets, starts, ticks

CASES = (*ticks.CASES, *day.CASES, *starts.CASES, *resets.CASES)

__all__ = ["CASES"]
