"""StressCase: what is done to evs, how wrong it may become, and what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Measurement:
    """What a stress case measured."""

    value: float
    """in `unit`; 0 if everything is right"""
    limit: float
    """largest value that is allowed; it follows from the bound of the case"""
    unit: str = ""
    messages: tuple[str, ...] = ()
    """what a user sees: warnings, counts of the report, the line of an error"""
    recovered: bool = True
    """whether the stream was right again afterwards"""

    @property
    def holds(self) -> bool:
        """Whether the bound is kept; NaN keeps no bound."""
        return self.recovered and self.value <= self.limit


@dataclass(frozen=True)
class StressCase:
    """One row of the table; `run` runs it through the real pipeline."""

    name: str
    """unique over all groups, words with hyphens: black-to-sun"""
    group: str
    """one of GROUPS"""
    what: str
    """what is done, for a reader of the table"""
    bound: str
    """what must hold and why, for the same reader"""
    run: Callable[[bool], Measurement]
    """takes `short`: True for `evs doctor`, a second or less; False for the full length"""


@dataclass(frozen=True)
class CaseResult:
    """A stress case that was run."""

    case: StressCase
    measurement: Measurement | None
    """None if it raised"""
    error: str
    """the exception in one line; empty: none"""
    seconds: float
    """wall clock"""

    @property
    def holds(self) -> bool:
        """Whether it has a measurement within its bound."""
        return self.measurement is not None and self.measurement.holds
