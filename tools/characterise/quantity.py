"""Quantity: one measured number beside its expected value."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A quantity of a sensor as the bench found it."""

    quantity: str
    """what was measured, in words; the same words for every sensor"""
    unit: str
    """SI or log (natural logarithm of light); empty for pure numbers"""
    measured: float
    """NaN: the bench could not tell, and `note` says why"""
    error: float
    """standard error of `measured`, from the spread over pixels, counts, or steps of the method"""
    set: float
    """what the parameters promise; NaN: nothing"""
    lux: float | None = None
    """illuminance of the sensor; None: where it does not matter"""
    note: str = ""

    @property
    def deviation(self) -> float:
        """measured / set - 1; NaN where one of them is not there or nothing was set."""
        return self.measured / self.set - 1.0 if self.set else math.nan

    @property
    def sigmas(self) -> float:
        """measured - set in standard errors; NaN where there are none."""
        return (self.measured - self.set) / self.error if self.error > 0.0 else math.nan
