"""Physics: any tick is filled exactly, by the fewest steps that are no longer than the model's."""

from __future__ import annotations

import math

import mujoco
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.emulator.world import Physics, fill_tick
from evs.msgs import EvsError


def test_the_choice_is_a_sentence():
    assert str(fill_tick(1000, 0.003)) == (
        "1 physics step of 1 ms in each tick of 1 ms (the model asks for 3 ms; "
        "scene.tick_us=3000 keeps it)"
    )
    assert str(fill_tick(1000, 0.0005)) == (
        "2 physics steps of 0.5 ms in each tick of 1 ms (as the model has it)"
    )


@pytest.mark.parametrize("tick_us", [0, -1000, 0.5, float("nan"), float("inf"), True, "1000"])
def test_a_tick_is_a_positive_whole_number(tick_us):
    with pytest.raises(EvsError, match="positive whole number of microseconds"):
        fill_tick(tick_us, 0.002)


@pytest.mark.parametrize(
    ("tick_us", "timestep_s", "kept_by"),
    [(1000, 0.002, "2000"), (1000, 0.0003, "900"), (5000, 0.003, "6000"), (1000, 1 / 60, "")],
)
def test_the_tick_that_keeps_the_models_step_is_named(tick_us, timestep_s, kept_by):
    said = str(fill_tick(tick_us, timestep_s))
    assert said.partition("scene.tick_us=")[2].partition(" ")[0] == kept_by
    if kept_by:
        assert fill_tick(int(kept_by), timestep_s).kept


def test_a_step_too_short_for_any_machine_is_refused():
    with pytest.raises(EvsError, match="1e-12 s: a tick of 1000 us would take 1e\\+09 steps"):
        fill_tick(1000, 1e-12)


@pytest.mark.parametrize("timestep_s", [0.0, math.nan, math.inf])
def test_a_timestep_is_positive_and_finite(timestep_s):
    with pytest.raises(EvsError, match=rf"the model's timestep is {timestep_s} s: it must be over"):
        fill_tick(1000, timestep_s)


def test_time_is_counted_and_not_accumulated():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep=".0003"/><worldbody><body><joint type="slide"/>
        <geom size=".1"/></body></worldbody></mujoco>"""
    )
    physics = Physics(model, 700)
    for tick in range(1, 1001):
        physics.advance()
        assert physics.t_us == 700 * tick
        assert physics.data.time == 700 * tick * 1e-6
    assert model.opt.timestep * physics.substeps.count == pytest.approx(700e-6, rel=1e-15)


@pytest.mark.property
@given(tick_us=st.integers(1, 1_000_000), timestep_s=st.floats(1e-6, 1.0))
def test_a_tick_is_filled_by_the_fewest_steps(tick_us, timestep_s):
    substeps = fill_tick(tick_us, timestep_s)
    tick_s = tick_us * 1e-6
    assert math.isclose(substeps.count * substeps.timestep_s, tick_s, rel_tol=1e-15)
    assert substeps.timestep_s <= timestep_s * (1 + 2e-9)
    assert substeps.count == 1 or tick_s / (substeps.count - 1) > timestep_s * (1 - 1e-12)


@pytest.mark.property
@given(count=st.integers(1, 5000), tick_us=st.integers(1, 100_000))
def test_a_time_step_that_divides_the_tick_is_kept(count, tick_us):
    assert fill_tick(tick_us, tick_us * 1e-6 / count).count == count
