"""The extremes of the network."""

from evs.tools.stress.network import clamps, memory

EXTREMES = (*memory.EXTREMES, *clamps.EXTREMES)

__all__ = ["EXTREMES"]
