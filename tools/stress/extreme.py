"""One extreme: what is done to evs, how wrong it may get, and what came of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Outcome:
    """What an extreme came to."""

    value: float
    """measured, in `unit`; 0 where everything is as it must be"""
    limit: float
    """the most that it may be; follows from the bound that the extreme states"""
    unit: str = ""
    said: tuple[str, ...] = ()
    """what a user is told: warnings, counts of the report, the line of a refusal"""
    recovered: bool = True
    """whether afterwards the stream was right again"""

    @property
    def holds(self) -> bool:
        """Whether the bound is kept; a NaN keeps none."""
        return self.recovered and self.value <= self.limit


@dataclass(frozen=True)
class Extreme:
    """One line of the table; `run` does it, through the real pipeline."""

    name: str
    """one of its kind over all groups, words with hyphens: black-to-sun"""
    group: str
    """one of GROUPS"""
    what: str
    """what is done, for a reader of the table"""
    bound: str
    """what must hold and where that follows from, for the same reader"""
    run: Callable[[bool], Outcome]
    """In: short, the short form for `evs doctor`, of a second or less; else the whole length"""


@dataclass(frozen=True)
class Tried:
    """An extreme that was run."""

    extreme: Extreme
    outcome: Outcome | None
    """None where it broke down"""
    error: str
    """what it broke down with, one line; else empty"""
    seconds: float
    """how long it took by the wall clock"""

    @property
    def holds(self) -> bool:
        """Whether it came to an outcome, and that within its bound."""
        return self.outcome is not None and self.outcome.holds
