"""The extremes of the machine."""

from evs.drivers.extremes.machine import clock, processor, scarce

EXTREMES = (*processor.EXTREMES, *clock.EXTREMES, *scarce.EXTREMES)

__all__ = ["EXTREMES"]
