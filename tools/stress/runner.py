"""Run stress cases one after the other; one that raises does not stop the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from evs.drivers.clock import monotonic_s
from evs.tools.stress.groups import GROUPS, cases_of
from evs.tools.stress.stress_case import CaseResult, StressCase


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
