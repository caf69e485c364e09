"""Any tick is filled exactly, by the fewest steps that are no longer than the model's."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.emulator.world import fill_tick

pytestmark = pytest.mark.property


@given(tick_us=st.integers(1, 1_000_000), timestep_s=st.floats(1e-6, 1.0))
def test_a_tick_is_filled_by_the_fewest_steps(tick_us, timestep_s):
    substeps = fill_tick(tick_us, timestep_s)
    tick_s = tick_us * 1e-6
    assert math.isclose(substeps.count * substeps.timestep_s, tick_s, rel_tol=1e-15)
    assert substeps.timestep_s <= timestep_s * (1 + 2e-9)
    assert substeps.count == 1 or tick_s / (substeps.count - 1) > timestep_s * (1 - 1e-12)


@given(count=st.integers(1, 5000), tick_us=st.integers(1, 100_000))
def test_a_time_step_that_divides_the_tick_is_kept(count, tick_us):
    assert fill_tick(tick_us, tick_us * 1e-6 / count).count == count
