"""Quantity: a measured number and its expected value; the rows of a table of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A quantity of a sensor as the bench found it."""

    quantity: str
    """what was measured, in words; the same words for every sensor"""
    unit: str
    """SI, log (natural logarithm of light) or % (of Weber contrast); empty for pure numbers"""
    measured: float
    """NaN: the bench could not measure it, and `note` says why"""
    error: float
    """standard error of `measured`, from the spread over pixels, counts, or steps of the method"""
    set: float
    """what follows from the parameters; NaN: nothing does"""
    lux: float | None = None
    """illuminance of the sensor; None: where it does not matter"""
    note: str = ""

    @property
    def deviation(self) -> float:
        """measured / set - 1; NaN if one of them is NaN or nothing was set."""
        return self.measured / self.set - 1.0 if self.set else math.nan

    @property
    def sigmas(self) -> float:
        """measured - set in standard errors; NaN if there is no error."""
        return (self.measured - self.set) / self.error if self.error > 0.0 else math.nan


HEADINGS = ("quantity", "at lux", "measured", "error", "set", "difference", "")

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))
_PREFIXED = ("s", "Hz", "ev/s")

NOTHING = "-"


def table_rows(results: Sequence[Quantity]) -> list[tuple[str, ...]]:
    """A row for each quantity, with the columns of HEADINGS; a name is in its first row only."""
    lines = []
    last = ""
    for result in results:
        name = "" if result.quantity == last else result.quantity
        last = result.quantity
        lines.append((name, *_row(result)))
    return lines


def _row(result: Quantity) -> tuple[str, ...]:
    measured, promised = result.measured, result.set
    size = max(abs(value) for value in (measured, promised, 0.0) if math.isfinite(value))
    factor, prefix = 1.0, ""
    if result.unit in _PREFIXED and size > 0.0:
        factor, prefix = next((p for p in _PREFIXES if size >= 0.9999 * p[0]), _PREFIXES[-1])
    unit = f" {prefix}{result.unit}" if result.unit else ""
    decimals = _decimals(result.error / factor, size / factor)

    def number(value: float) -> str:
        return f"{value / factor:.{decimals}f}{unit}" if math.isfinite(value) else NOTHING

    at = NOTHING if result.lux is None else f"{result.lux:g}"
    difference = f"{100.0 * result.deviation:+.2f} %" if math.isfinite(result.deviation) else ""
    error = f"{result.error / factor:.{decimals}f}" if math.isfinite(result.error) else ""
    return at, number(measured), error, number(promised), difference, result.note


def _decimals(error: float, size: float) -> int:
    """Decimals that give the error two digits; without an error, the number four."""
    scale = error / 10.0 if math.isfinite(error) and error > 0.0 else size / 1000.0
    if not scale > 0.0:
        return 0
    return min(max(0, math.ceil(-math.log10(scale))), 7)
