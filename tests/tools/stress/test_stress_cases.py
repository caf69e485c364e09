"""Every stress case at full length; `evs doctor` runs their short form."""

from __future__ import annotations

import pytest

from evs.tools.stress import GROUPS, StressCase, cases_of, run_case

pytestmark = [pytest.mark.extremes, pytest.mark.slow]


@pytest.mark.parametrize(
    "case",
    [case for group in GROUPS for case in cases_of(group)],
    ids=lambda case: f"{case.group}-{case.name}",
)
def test_a_stress_case_keeps_its_bound(case: StressCase) -> None:
    result = run_case(case)
    assert result.holds, (result.measurement, result.error)
