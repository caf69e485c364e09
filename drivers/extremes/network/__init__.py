"""The extremes of the network."""

from evs.drivers.extremes.network import clamps, memory

EXTREMES = (*memory.EXTREMES, *clamps.EXTREMES)

__all__ = ["EXTREMES"]
