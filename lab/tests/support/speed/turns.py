"""Timings that take turns, and the table that shows them: medians, quartiles and ratios."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Calls = dict[str, Callable[[], object]]
ROUNDS = 15


@dataclass(frozen=True)
class Time:
    """The time of one call, in ms: the median and the quartiles."""

    median: float
    low: float
    high: float

    def __truediv__(self, shared: float) -> Time:
        """Return the time of one part of the call, such as one sample of 16."""
        return Time(self.median / shared, self.low / shared, self.high / shared)

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.low:.3g}-{self.high:.3g})"


def milliseconds(calls: Calls, rounds: int = ROUNDS) -> dict[str, Time]:
    """Time each call. They take turns, so that drift cancels; the first round is not counted."""
    samples: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds + 1):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            samples[name].append(1e3 * (time.perf_counter() - begin))
    return {name: spread(taken[1:]) for name, taken in samples.items()}


def spread(samples: list[float]) -> Time:
    """Return the median and the quartiles of some samples."""
    low, high = np.quantile(samples, (0.25, 0.75)).tolist()
    return Time(statistics.median(samples), low, high)


@dataclass(frozen=True)
class Table:
    """One topic: the rows are the calls that are timed, the columns are scenes."""

    title: str
    columns: dict[str, dict[str, Time]]
    """scene -> row -> time"""
    yardsticks: dict[str, str]
    """row -> the row that it is compared with"""

    def ratio(self, scene: str, row: str) -> float:
        """Return how many times as fast as its yardstick a row is."""
        times = self.columns[scene]
        return times[self.yardsticks[row]].median / times[row].median

    def __str__(self) -> str:
        """The text: median (quartiles), and how many times as fast as the yardstick."""
        rows = [part for row, yardstick in self.yardsticks.items() for part in (yardstick, row)]
        cells = [["ms: median (quartiles)", *self.columns]]
        for row in dict.fromkeys(rows):
            cells.append([row, *(self._cell(scene, row) for scene in self.columns)])
        wide = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  ".join(f"{cell:{n}}" for cell, n in zip(line, wide, strict=True)).rstrip()
            for line in cells
        ]
        return "\n".join([f"\n{self.title}", *lines])

    def _cell(self, scene: str, row: str) -> str:
        faster = f" {self.ratio(scene, row):.3g}x" if row in self.yardsticks else ""
        return f"{self.columns[scene][row]}{faster}"


def target(what: str, found: float, bound: float, unit: str) -> str:
    """Report in one line whether a target is met.

    Args:
        what: What the target is about.
        found: The value that was measured.
        bound: The bound: the least value if the unit is "x", else the largest.
        unit: The unit of both values.
    """
    met = found >= bound if unit == "x" else found <= bound
    side = "at least" if unit == "x" else "at most"
    verdict = "met" if met else "MISSED"
    return f"target: {what} {side} {bound:g} {unit}: {found:.3g} {unit}, {verdict}"
