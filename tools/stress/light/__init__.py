"""Stress cases of light."""

from evs.tools.stress.light import invalid, levels, pulses, sun

CASES = (*levels.CASES, *sun.CASES, *pulses.CASES, *invalid.CASES)

__all__ = ["CASES"]
