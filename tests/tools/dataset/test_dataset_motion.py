"""Motion of a data set's scenes: curves through points, seams, shaking, and bad tracks."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.msgs import EvsError
from evs.tools.dataset.motion import Track, control_of

MODEL = """
<mujoco>
  <worldbody>
    <body><joint name="a" type="slide"/><joint name="b" type="slide"/><geom size="0.1"/></body>
  </worldbody>
  <actuator><motor name="a" joint="a"/><motor name="b" joint="b"/></actuator>
</mujoco>
"""


def described(track: Track, times: list[float], seed: int = 0) -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(MODEL)
    control = control_of([track], model, seed)
    rows = [control(t_s, None) for t_s in times]
    return np.array(rows, float)


def test_a_curve_goes_through_its_points_and_holds_outside() -> None:
    track = Track("b", ((1.0, 2.0), (2.0, -1.0), (4.0, 0.5)))
    found = described(track, [0.0, 1.0, 2.0, 4.0, 9.0])
    assert found[:, 1].tolist() == [2.0, 2.0, -1.0, 0.5, 0.5]
    # the other actuator is told nothing
    assert not found[:, 0].any()


def test_two_points_are_a_straight_line() -> None:
    found = described(Track("a", ((0.0, 0.0), (2.0, 3.0))), [0.25, 0.5, 1.5])
    np.testing.assert_allclose(found[:, 0], [0.375, 0.75, 2.25], rtol=1e-14)


@given(st.floats(0.1, 3.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_a_period_repeats_without_a_step_or_a_kink(period_s: float, v0: float, v1: float) -> None:
    track = Track("a", ((0.0, v0), (period_s * 0.4, v1)), period_s=period_s)
    eps = period_s * 1e-5
    seam = described(track, [period_s - eps, period_s, period_s + eps, 5 * period_s + eps])[:, 0]
    slope = 3 * abs(v1 - v0) / (0.4 * period_s)
    # no step: a Hermite cubic between these points has no slope over 3 times the chord's
    assert abs(seam[1] - seam[0]) <= slope * eps + 1e-9
    # no kink: the slopes on both sides differ by the curvature over eps only
    assert (
        abs((seam[2] - seam[1]) - (seam[1] - seam[0])) <= 20 * slope * eps * eps / period_s + 1e-9
    )
    assert seam[3] == pytest.approx(seam[2], abs=1e-8)


def test_shaking_begins_at_rest_stays_within_its_bound_and_follows_the_seed() -> None:
    track = Track("a", shake=0.2, shake_hz=5.0)
    times = list(np.linspace(0, 10, 2001))
    one, again, other = (described(track, times, seed)[:, 0] for seed in (1, 1, 2))
    assert one[0] == 0.0
    assert np.abs(one).max() <= 0.2
    assert np.array_equal(one, again)
    assert np.abs(one - other).max() > 0.05
    # targets are all over the range, and it glides: a smoothstep's slope is 1.5 of the chord's
    assert one.max() > 0.1
    assert one.min() < -0.1
    assert np.abs(np.diff(one)).max() <= 0.4 * 5.0 * 1.5 * 0.005 + 1e-12


@pytest.mark.parametrize(
    ("track", "says"),
    [
        (Track("c"), "at motion.0.actuator: no actuator 'c'; there is: a, b"),
        (Track("a", ()), "at motion.0.at: give points"),
        (Track("a", ((1.0, 0.0), (1.0, 2.0))), "with t growing"),
        (Track("a", ((0.0, float("nan")),)), "every number has to be finite"),
        (Track("a", shake_hz=0.0), "shake_hz over 0"),
        (Track("a", ((0.0, 0.0), (2.0, 1.0)), period_s=1.5), "at motion.0.period_s"),
    ],
)
def test_a_bad_track_is_told_with_its_place(track: Track, says: str) -> None:
    with pytest.raises(EvsError) as caught:
        described(track, [0.0])
    assert says in str(caught.value)


def test_an_actuator_has_one_track() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    with pytest.raises(EvsError, match="'a' has two tracks"):
        control_of([Track("a"), Track("a")], model, 0)
