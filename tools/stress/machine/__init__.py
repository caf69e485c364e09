"""The extremes of the machine."""

from evs.tools.stress.machine import clock, processor, scarce

EXTREMES = (*processor.EXTREMES, *clock.EXTREMES, *scarce.EXTREMES)

__all__ = ["EXTREMES"]
