"""Estimate: a key of [sensor] as a recording tells it, with its standard error, or why not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

CANNOT = "cannot be told from this recording"


@dataclass(frozen=True)
class Estimate:
    """A parameter of a sensor, estimated from a recording."""

    key: str
    """dotted, without `sensor.`: pos_thres, readout.scan_us"""
    value: float | str = math.nan
    """in the unit of the key; NaN: it cannot be told"""
    error: float = math.nan
    """standard error; systematic errors that the method has are part of it; NaN: of a word"""
    source: str = ""
    """the recording"""
    reason: str = ""
    """why it cannot be told; empty: it can"""
    note: str = ""
    """what a reader should know of the value"""

    @property
    def told(self) -> bool:
        """Whether the recording tells the value."""
        return not self.reason

    @property
    def number(self) -> float:
        """The value as a number; NaN: it is a word, or cannot be told."""
        return self.value if isinstance(self.value, float) else math.nan

    def checked(self, largest: float = 0.5) -> Estimate:
        """The same, but "cannot be told" where the error is too large for the value.

        Args:
            largest: The largest error, relative to the value, of a value that means something.
        """
        if not self.told or isinstance(self.value, str):
            return self
        if not math.isfinite(self.value) or not math.isfinite(self.error):
            return cannot(self.key, self.source, "the fit has no solution")
        if self.value != 0.0 and self.error > largest * abs(self.value):
            found = f"{self.value:.2g} +- {self.error:.2g}"
            return cannot(self.key, self.source, f"the error is as large as the value ({found})")
        return self

    def plain(self) -> dict[str, Any]:
        """Plain values for JSON; None for NaN."""
        return {
            "key": self.key,
            "value": _or_none(self.value),
            "error": _or_none(self.error),
            "source": self.source,
            "told": self.told,
            "reason": self.reason,
            "note": self.note,
        }


def cannot(key: str, source: str, reason: str) -> Estimate:
    """An estimate that this recording does not allow."""
    return Estimate(key, source=source, reason=reason)


def combined(estimates: list[Estimate]) -> list[Estimate]:
    """One estimate for each key: the best of several recordings, in order of first appearance.

    The smallest relative error wins; estimates are not averaged, since those of two recordings
    may share a systematic error.
    """
    best: dict[str, Estimate] = {}
    for one in estimates:
        known = best.get(one.key)
        if known is None or _rank(one) < _rank(known):
            best[one.key] = one
        elif not one.told and not known.told and one.reason not in known.reason:
            best[one.key] = replace(known, reason=f"{known.reason}; {one.reason}")
    return list(best.values())


def _rank(one: Estimate) -> float:
    if not one.told:
        return math.inf
    if isinstance(one.value, str):
        return 0.0
    return one.error / abs(one.value) if one.value else one.error


def _or_none(value: float | str) -> float | str | None:
    return value if isinstance(value, str) or math.isfinite(value) else None
