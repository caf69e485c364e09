"""Stress cases of the machine."""

from evs.tools.stress.machine import clock, processor, resources

CASES = (*processor.CASES, *clock.CASES, *resources.CASES)

__all__ = ["CASES"]
