"""Stress cases of the network."""

from evs.tools.stress.network import clamps, memory

CASES = (*memory.CASES, *clamps.CASES)

__all__ = ["CASES"]
