"""A world that breaks down, or leaves a limit, ends alone; the others do not lose a byte."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop, World, Worlds
from evs.emulator.config import SensorConfig
from reference.worlds_alone import (
    SWING,
    Alone,
    assert_same_states,
    both,
    by_world,
    change_both,
    raw,
    step_both,
)

SMALL = SensorConfig("dvs128", width=40, height=32)
CAMERAS = [{"camera": "left", "sensor": SMALL}]
LIMITS = {"angle": (-1.0, 0.05), "rate": (-1e3, 1e3)}


def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SWING)


def pushed(count: int = 4, **options: Any) -> tuple[Worlds, Alone]:
    """Worlds that have done 3 ticks."""
    worlds, alone = both(model(), count, CAMERAS, **options)
    change_both(worlds, alone, lambda number, world: world.data.qvel.fill(5.0 + number))
    assert step_both(worlds, alone, ticks=3) > 0
    return worlds, alone


def explode(number: int, data: Any) -> None:
    """An absurd velocity."""
    data.qvel[0] = 1e13


@pytest.mark.parametrize("sensors", [None, ()], ids=["unmeasured", "measured"])
def test_an_unstable_world_ends_alone_with_the_message_of_world(
    sensors: tuple[str, ...] | None, capfd: pytest.CaptureFixture[str]
) -> None:
    worlds, alone = pushed(sensors=sensors)
    for number in (1, 3):
        explode(number, worlds.world(number).data)
        explode(number, alone.each[number].data)
    # the messages are compared here
    assert step_both(worlds, alone, ticks=4) > 0
    assert [*worlds.ended] == [1, 3]
    assert worlds.ended[1].startswith("unstable at t = 0.003000 s: bad velocity")
    assert "joint 'swing' of body 'arm'" in worlds.ended[1]
    assert worlds.t_us.tolist() == [7000, 3000, 7000, 3000]
    assert_same_states(worlds, alone)
    # it stands still
    seen, *_ = worlds.step(ticks=3)
    assert [raw(events) for events in seen] == alone.step(ticks=3)[0]
    assert (seen.counts == 0).tolist() == [False, True, False, True]
    # MuJoCo's own warning goes to stdout or stderr
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("count", [1, 2])
def test_it_ends_within_a_step_and_keeps_the_events_until_then(count: int) -> None:
    mad = '<position name="mad" joint="swing" kp="-3e6"/><motor'
    scene = mujoco.MjModel.from_xml_string(SWING.replace("<motor", mad))
    worlds, alone = both(scene, count, CAMERAS)
    # its actuator drives it away from where it should be; the first world has not left it
    controls = [[0.0, 0.0], [0.001, 0.0]][-count:]
    assert step_both(worlds, alone, controls, ticks=300) > 0
    assert count - 1 in worlds.ended
    assert 0 < worlds.t_us[-1] < 300_000
    assert_same_states(worlds, alone)


def test_a_start_that_breaks_down_and_a_reset_that_mends() -> None:
    worlds, alone = pushed()
    worlds.reset(worlds=[0, 2], start=explode)
    for number in (0, 2):
        alone.each[number].reset()
        explode(number, alone.each[number].data)
    step_both(worlds, alone, ticks=2)
    assert [*worlds.ended] == [0, 2]
    assert worlds.t_us.tolist() == [0, 5000, 0, 5000]

    worlds.reset(worlds=[0])
    alone.each[0].reset()
    del alone.ended[0]
    assert [*worlds.ended] == [2]
    step_both(worlds, alone, ticks=2)
    assert worlds.t_us.tolist() == [2000, 7000, 0, 7000]

    blob = worlds.save([1])
    worlds.restore(blob, [2])
    alone.each[2].restore(blob[0])
    del alone.ended[2]
    assert worlds.ended == {}
    assert step_both(worlds, alone, ticks=2) > 0
    assert_same_states(worlds, alone)


def test_all_may_end() -> None:
    worlds, alone = pushed(2)
    worlds.reset(start=explode)
    worlds.step(ticks=3)
    assert [*worlds.ended] == [0, 1]
    (seen,) = worlds.step(ticks=3)
    assert (len(seen), len(seen.events)) == (2, 0)
    worlds.reset()
    for world in alone.each:
        world.reset()
    step_both(worlds, alone, ticks=3)


@pytest.mark.parametrize(
    ("memory", "reason"), [("60K", "mj_stackAlloc: out of memory"), ("200K", "contact buffer full")]
)
def test_a_full_buffer_ends_a_world_with_its_message(
    memory: str, reason: str, capfd: pytest.CaptureFixture[str]
) -> None:
    boxes = "".join(
        f'<body pos="{0.1 * (k % 10)} {0.1 * (k // 10)} .04"><freejoint/>'
        '<geom type="box" size=".05 .05 .05"/></body>'
        for k in range(60)
    )
    xml = SWING.replace("<option", f'<size memory="{memory}"/><option')
    xml = xml.replace("</worldbody>", f"{boxes}</worldbody>").replace(' qpos="-1"', "")
    worlds, alone = both(mujoco.MjModel.from_xml_string(xml), 2, CAMERAS)
    step_both(worlds, alone, ticks=2)
    assert [*worlds.ended] == [0, 1]
    assert worlds.ended[0].startswith(f"unstable at t = 0.000000 s: {reason}")
    assert_same_states(worlds, alone)
    assert capfd.readouterr() == ("", "")


class Loops:
    """The same worlds, each alone in a ClosedLoop with the limits."""

    def __init__(self, worlds: Worlds, limits: Any) -> None:
        self.each = [
            ClosedLoop(model(), "left", sensor=SMALL, limits=limits, seed=seed)
            for seed in worlds.seeds
        ]
        self.events = [b""] * len(self.each)

    def reset(self) -> None:
        for number, loop in enumerate(self.each):
            loop.reset(seed=number, start=lambda data, n=number: start(n, data))

    def step(self, ticks: int) -> None:
        for number, loop in enumerate(self.each):
            if not loop.done:
                seen = loop.step([0.0], ticks=ticks)
                self.events[number] += b"".join(raw(one.events) for one in seen.packets)


def start(number: int, data: Any) -> None:
    data.qvel[0] = 5.0 * number


@pytest.mark.parametrize("count", [1, 3])
def test_a_world_that_leaves_a_limit_ends_as_the_closed_loop_does(count: int) -> None:
    worlds = Worlds(model(), count, limits=LIMITS)
    worlds.add_camera("left", sensor=SMALL)
    loops = Loops(worlds, LIMITS)
    loops.reset()
    worlds.reset([*range(count)], start=start)
    seen = [b""] * count
    for ticks in (1, 30, 40):
        (events,) = worlds.step([[0.0]] * count, ticks=ticks)
        seen = [before + raw(one) for before, one in zip(seen, events, strict=True)]
        loops.step(ticks)
        ends = {number: loop.done for number, loop in enumerate(loops.each) if loop.done}
        assert worlds.ended == ends
        assert worlds.t_us.tolist() == [loop.t_us for loop in loops.each]
    assert worlds.ended.get(count - 1) == "angle left -1 ... 0.05"
    assert seen == loops.events
    for number, loop in enumerate(loops.each):
        assert worlds.world(number).state.tobytes() == loop.world.state.tobytes()


def test_a_start_outside_the_limits_ends_at_once() -> None:
    worlds = Worlds(model(), 3, limits={"angle": (-0.5, 0.5)})
    worlds.add_camera("left", sensor=SMALL)
    assert worlds.ended == {}

    def lean(number: int, data: Any) -> None:
        data.qpos[0] = (0.0, 0.6, np.nan)[number]

    worlds.reset(start=lean)
    assert worlds.ended == {1: "angle left -0.5 ... 0.5", 2: "angle left -0.5 ... 0.5"}
    worlds.step()
    assert worlds.t_us.tolist() == [1000, 0, 0]
    # a saved state outside is one too
    worlds.restore([worlds.save([1])[0]], [0])
    assert [*worlds.ended] == [1, 2, 0]


def test_worlds_that_are_made_outside_the_limits_have_ended() -> None:
    worlds = Worlds(model(), 2, limits={"angle": (0.5, 1.0)})
    assert worlds.ended == dict.fromkeys(range(2), "angle left 0.5 ... 1")


def test_an_unstable_world_is_measured_where_it_stopped() -> None:
    worlds, alone = pushed(2, sensors=("angle",))
    explode(1, worlds.world(1).data)
    worlds.step(ticks=2)
    assert [*worlds.ended] == [1]
    assert worlds.readings["angle"][1].tolist() == alone.each[1].data.qpos.tolist()
    assert worlds.velocity[1].tolist() == [1e13 * 2]


def test_another_message_or_another_end_would_be_found() -> None:
    worlds, alone = pushed(2)
    explode(0, worlds.world(0).data)
    with pytest.raises(AssertionError):
        step_both(worlds, alone, ticks=2)
    worlds, alone = pushed(2)
    explode(0, worlds.world(0).data)
    alone.each[0].data.qvel[0] = -1e14
    alone.each[0].data.qpos[0] = 1e14
    with pytest.raises(AssertionError):
        step_both(worlds, alone, ticks=2)
    assert by_world(worlds.step()) == [[b"", raw(alone.each[1].step()[0].events)]]
    assert isinstance(alone.each[0], World)
