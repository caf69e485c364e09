"""The extremes of the sensor."""

from evs.drivers.extremes.sensor import bandwidth, readout, size, thresholds

EXTREMES = (*thresholds.EXTREMES, *bandwidth.EXTREMES, *readout.EXTREMES, *size.EXTREMES)

__all__ = ["EXTREMES"]
