"""How an episode of a closed loop ends: limits, time, physics that breaks down."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop
from evs.msgs import EvsError
from reference.closed_cart import CART, SMALL, drive, make


@pytest.fixture(scope="module")
def cart():
    return mujoco.MjModel.from_xml_string(CART)


def test_a_limit_ends_the_episode_in_the_tick_in_which_it_is_left(cart):
    loop = make(cart, limits={"tilt": (-0.5, 0.5)})
    seen = drive(loop, [], keyframe="leaning")[0]
    while not seen.done:
        before = loop.world.data.qpos[1]
        seen = loop.step((0.0, 0.0), ticks=3)
    assert seen.done == loop.done == "tilt left -0.5 ... 0.5"
    assert before < 0.5 < loop.world.data.qpos[1]
    # of three ticks the first in which it was outside is the last
    assert 0.5 < loop.world.data.qpos[1] < 0.5 + 0.001 * loop.world.data.qvel[1] + 1e-3
    at = loop.t_us
    with pytest.raises(EvsError, match=r"^the episode is over \(tilt left .*\): call reset$"):
        loop.step()
    assert loop.t_us == at
    assert loop.reset().done == ""


def test_an_episode_may_be_over_before_it_begins(cart):
    loop = make(cart, limits={"tilt": (-0.1, 0.1)})
    assert loop.reset(keyframe="leaning").done == "tilt left -0.1 ... 0.1"
    with pytest.raises(EvsError, match="is over"):
        loop.step()


def test_sensors_of_every_stage_can_be_limits():
    drop = CART.replace('pos="0 0 .2"><joint', 'pos="0 0 3"><joint name="fall" type="slide" '
                        'axis="0 0 1"/><joint')  # fmt: skip
    model = mujoco.MjModel.from_xml_string(drop.replace('<key name="leaning" qpos="0 .2"/>', ""))
    for name, limit in (("speed", (-0.1, 0.1)), ("bump", (-1.0, 0.5))):
        loop = ClosedLoop(model, sensor=SMALL, limits={name: limit})
        seen = loop.reset()
        while not seen.done and seen.t_us < 2_000_000:
            seen = loop.step((1.0, 0.0))
        assert seen.done == f"{name} left {limit[0]:g} ... {limit[1]:g}"
        assert 1000 < seen.t_us < (100_000 if name == "speed" else 2_000_000)


def test_a_touch_is_a_limit_as_soon_as_it_is_felt():
    xml = """<mujoco><option timestep=".001"/><worldbody><light pos="0 0 3"/><camera name="c"
    pos="0 -2 1" xyaxes="1 0 0 0 0 1"/><geom type="plane" size="1 1 1"/><body pos="0 0 .5">
    <freejoint/><geom size=".1"/><site name="skin" size=".12"/></body></worldbody>
    <sensor><touch name="bump" site="skin"/></sensor></mujoco>"""
    loop = ClosedLoop(mujoco.MjModel.from_xml_string(xml), sensor=SMALL, limits={"bump": (0, 1)})
    seen = loop.reset()
    while not seen.done:
        seen = loop.step(ticks=10)
    assert seen.done == "bump left 0 ... 1"
    # 0.4 m of free fall
    assert seen.t_us == pytest.approx(1e6 * (2 * 0.4 / 9.81) ** 0.5, abs=3000)


def test_time_ends_it(cart):
    loop = make(cart, max_s=0.0105)
    loop.reset()
    seen = loop.step(ticks=1000)
    assert (seen.done, seen.t_us, len(seen.packets)) == ("0.0105 s are over", 11_000, 22)


def test_a_world_that_breaks_down_ends_it_and_what_came_before_stays(cart):
    def start(data):
        data.qvel[0] = 1e9

    loop = make(cart)
    loop.reset(state=True)
    good = loop.step((0.1, 0.0), ticks=5)
    loop.world.data.qvel[0] = 1e12
    seen = loop.step((0.1, 0.0), ticks=5)
    assert seen.done.startswith("unstable at t = 0.00")
    assert "\n" not in seen.done
    assert np.isfinite(seen.state).all()
    assert np.isfinite(seen.position).all()
    assert seen.t_us == good.t_us + 1000 * (len(seen.packets) // 2)
    assert loop.reset().done == ""
    assert loop.step().t_us == 1000


@pytest.mark.parametrize(
    ("max_s", "end_us"), [(2.007, 2_007_000), (1.001, 1_001_000), (1e-9, 1000)]
)
def test_time_is_over_in_the_tick_that_was_said(cart, max_s, end_us):
    # 2.007 * 1e6 is a little over 2007000
    loop = ClosedLoop(cart, cameras=(), max_s=max_s)
    loop.reset()
    assert loop.step(ticks=3000).t_us == end_us
