"""The extremes of the sensor."""

from evs.tools.stress.sensor import bandwidth, readout, size, thresholds

EXTREMES = (*thresholds.EXTREMES, *bandwidth.EXTREMES, *readout.EXTREMES, *size.EXTREMES)

__all__ = ["EXTREMES"]
