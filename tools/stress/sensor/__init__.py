"""Stress cases of the sensor."""

from evs.tools.stress.sensor import bandwidth, readout, size, thresholds

CASES = (*thresholds.CASES, *bandwidth.CASES, *readout.CASES, *size.CASES)

__all__ = ["CASES"]
