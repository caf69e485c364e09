"""The extremes of the sensor, at full length; `evs doctor` runs their short form."""

from __future__ import annotations

import pytest

from evs.tools.stress import StressCase, cases_of, run_case

pytestmark = pytest.mark.extremes


@pytest.mark.slow
@pytest.mark.parametrize("case", cases_of("sensor"), ids=lambda case: case.name)
def test_an_extreme_of_the_sensor_keeps_its_bound(case: StressCase) -> None:
    tried = run_case(case)
    assert tried.holds, tried
