"""Stress cases: one row of the table, its groups, and the run of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from evs.drivers.clock import monotonic_s
from evs.msgs import unknown
from evs.msgs.registry import load


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


_CASES = {
    "light": "evs_lab.stress.light:CASES",
    "time": "evs_lab.stress.time:CASES",
    "motion": "evs_lab.stress.motion:CASES",
    "sensor": "evs_lab.stress.sensor:CASES",
    "network": "evs_lab.stress.network:CASES",
    "machine": "evs_lab.stress.machine:CASES",
}
"""group -> where its cases are, imported on demand; add a case to the module of its group"""

GROUPS = tuple(_CASES)
"""every group, in the order of the table"""


def cases_of(group: str) -> tuple[StressCase, ...]:
    """The cases of a group, in the order of the table.

    Raises:
        EvsError: there is no such group.
    """
    if group not in _CASES:
        raise unknown("group of extremes", group, GROUPS)
    cases: tuple[StressCase, ...] = load(_CASES[group])
    return cases


def run_cases(
    groups: Iterable[str] = GROUPS,
    short: bool = False,
    on_done: Callable[[CaseResult], None] | None = None,
) -> list[CaseResult]:
    """Run every case of the groups, in the order of the table.

    Args:
        groups: names of GROUPS.
        short: run the short form, as `evs doctor` does.
        on_done: called with each result at once.

    Raises:
        EvsError: a group does not exist; nothing has run then.
    """
    chosen = [case for group in groups for case in cases_of(group)]
    results = []
    for case in chosen:
        results.append(run_case(case, short))
        if on_done is not None:
            on_done(results[-1])
    return results


def run_case(case: StressCase, short: bool = False) -> CaseResult:
    """Run one case; an exception becomes its error."""
    begin_s = monotonic_s()
    try:
        measurement, error = case.run(short), ""
    except Exception as reason:
        words = " ".join(str(reason).split())
        measurement, error = None, f"{type(reason).__name__}: {words}" if words else repr(reason)
    return CaseResult(case, measurement, error, monotonic_s() - begin_s)
