"""Axes of charts: positions of values, and the numbers at the ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))


@dataclass(frozen=True)
class Scale:
    """One axis. Logarithmic ones have low > 0."""

    low: float
    high: float
    log: bool = False
    unit: str = ""
    """follows each number, with a prefix (k, m, u ...)"""
    shown: tuple[float, ...] = ()
    """the numbers at the ticks; empty: round ones"""

    def place(self, value: float) -> float:
        """Position of a value: 0 at `low`, 1 at `high`, outside that range beyond; NaN: none."""
        if not math.isfinite(value) or (self.log and value <= 0.0):
            return math.nan
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def ticks(self, most: int = 7) -> list[tuple[float, str]]:
        """Round numbers inside the axis, and their texts."""
        values = self._decades(most) if self.log else self._round(most)
        values = list(self.shown) or values
        return [(value, self.words(value)) for value in values]

    def words(self, value: float) -> str:
        """A number with prefix and unit, such as 20 kHz."""
        if value == 0.0:
            return f"0 {self.unit}".strip()
        size = abs(value)
        factor, prefix = next((p for p in _PREFIXES if size >= 0.9999 * p[0]), _PREFIXES[-1])
        # numbers without a unit, less than 1, are easier as they are
        if not self.unit and size < 1.0:
            factor, prefix = 1.0, ""
        return f"{value / factor:.3g} {prefix}{self.unit}".strip()

    def _decades(self, most: int) -> list[float]:
        first = math.ceil(math.log10(self.low) - 1e-9)
        last = math.floor(math.log10(self.high) + 1e-9)
        step = max(1, -(-(last - first + 1) // most))
        decades = [10.0**exponent for exponent in range(first, last + 1, step)]
        if len(decades) > 2:
            return decades
        # a short axis: 1, 2, 5
        some = [m * 10.0**e for e in range(first - 1, last + 1) for m in (1.0, 2.0, 5.0)]
        return [value for value in some if self.low <= value * 1.000001 and value <= self.high]

    def _round(self, most: int) -> list[float]:
        span = self.high - self.low
        rough = span / most
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(m * power for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= rough)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [step * k for k in range(first, last + 1)]

    def minor(self) -> list[float]:
        """Minor ticks of a logarithmic axis: 2 ... 9 times each decade inside."""
        if not self.log or self.shown:
            return []
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        if last - first > 8:
            return []
        every = [m * 10.0**e for e in range(first, last) for m in range(2, 10)]
        return [value for value in every if self.low < value < self.high]


def decades_around(values: list[float], least: float = 1.0) -> tuple[float, float]:
    """(low, high): powers of ten around the positive ones among them, `least` decades apart."""
    good = [value for value in values if math.isfinite(value) and value > 0.0]
    if not good:
        return 0.1, 10.0
    low = math.floor(math.log10(min(good)) + 1e-9)
    high = math.ceil(math.log10(max(good)) - 1e-9)
    return 10.0**low, 10.0 ** max(high, low + least)


def steps_around(values: list[float]) -> tuple[float, float]:
    """(low, high): 1, 2 or 5 times powers of ten around the positive ones, with a margin.

    At least a factor of 10 apart.
    """
    good = [value for value in values if math.isfinite(value) and value > 0.0]
    if not good:
        return 0.1, 10.0
    below, above = min(good) / 1.15, max(good) * 1.15
    first, last = math.floor(math.log10(below)), math.ceil(math.log10(above))
    steps = [m * 10.0**e for e in range(first - 1, last + 2) for m in (1.0, 2.0, 5.0)]
    low = max(step for step in steps if step <= below)
    return low, min(step for step in steps if step >= max(above, 9.99 * low))
