"""scene.start_us: the same stream, that much later, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import ClosedLoop, World
from evs.emulator.base.stamps import MAX_START_US
from evs.emulator.config import (
    ApsConfig,
    FlickerConfig,
    ImuConfig,
    ModelConfig,
    ReadoutConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    SensorConfig,
)
from evs.msgs import EvsError

PENDULUM = SceneConfig(file="config/scenes/pendulum.xml", camera="front", control="random")
SENSOR = SensorConfig(
    preset="davis346",
    width=32,
    height=24,
    shot_noise_rate_hz=20.0,
    aps=ApsConfig(enabled=True, exposure_us=2000),
    imu=ImuConfig(enabled=True),
    readout=ReadoutConfig(order="scan", scan_us=333),
)
PATH = RenderConfig(
    renderer="path", spp=1, seeds="fresh", flicker=(FlickerConfig(hz=37.0, depth=0.5),)
)
CONFIG = RunConfig(
    scene=PENDULUM, sensor=SENSOR, render=PATH, model=ModelConfig(labels=True), threads=1
)
STARTS = [2**31, 1_732_233_600_000_000, MAX_START_US]


def world_of(start_us: int) -> World:
    return World.from_config(replace(CONFIG, scene=replace(PENDULUM, start_us=start_us)))


@pytest.mark.parametrize("start_us", STARTS)
def test_everything_is_the_same_and_later_by_the_start(start_us: int) -> None:
    usual, late = world_of(0), world_of(start_us)
    count = {"events": 0, "frames": 0, "samples": 0}
    for _ in range(60):
        (a,), (b,) = usual.step(), late.step()
        one, other = usual.cameras[0], late.cameras[0]
        assert late.t_us - usual.t_us == start_us == late.start_us
        assert (b.time_base_us, b.time_end_us) == (
            a.time_base_us + start_us,
            a.time_end_us + start_us,
        )
        assert np.array_equal(a.events["t"] + start_us, b.events["t"])
        for name in "xyp":
            assert np.array_equal(a.events[name], b.events[name])
        # nothing else in the bytes that go over the bus
        assert not b.events.view(np.uint8).reshape(-1, 16)[:, 13:].any()
        assert np.array_equal(a.labels, b.labels)
        for first, second in zip(one.frames, other.frames, strict=True):
            assert np.array_equal(first.pixels, second.pixels)
            for stamp in ("begin_us", "exposure_begin_us", "exposure_end_us", "end_us"):
                assert getattr(second, stamp) == getattr(first, stamp) + start_us
        assert np.array_equal(one.imu["t"] + start_us, other.imu["t"])
        assert np.array_equal(one.imu["acceleration"], other.imu["acceleration"])
        assert one.pose is not None
        assert other.pose == replace(one.pose, t_us=one.pose.t_us + start_us)
        count["events"] += len(a)
        count["frames"] += len(one.frames)
        count["samples"] += len(one.imu)
    assert all(count.values()), count
    assert late.cameras[0].ground_truth().t_us == late.t_us


def test_a_view_and_a_saved_state_know_the_start() -> None:
    start_us = STARTS[1]
    config = replace(CONFIG, scene=replace(PENDULUM, start_us=start_us))
    world, view = World.with_view(config)
    world.step()
    assert view.t_us == view.ground_truth().t_us == world.t_us == start_us + 1000
    one = world_of(start_us)
    for _ in range(5):
        one.step()
    blob = one.save()
    other = world_of(start_us)
    other.restore(blob)
    assert np.array_equal(one.step()[0].events, other.step()[0].events)
    with pytest.raises(EvsError, match="start_us"):
        world_of(0).restore(blob)


def test_an_episode_is_as_long_wherever_it_begins() -> None:
    ends = []
    for start_us in (0, STARTS[1]):
        plain = replace(CONFIG, scene=replace(PENDULUM, start_us=start_us), sensor=SensorConfig())
        loop = ClosedLoop.around(World.from_config(plain), max_s=0.005)
        seen = loop.reset()
        while not seen.done:
            seen = loop.step()
        ends.append(seen.t_us - start_us)
    assert ends == [5000, 5000]


@pytest.mark.parametrize("start_us", [-1, MAX_START_US + 1, 2**63])
def test_no_time_to_begin_at(start_us: int) -> None:
    with pytest.raises(EvsError, match=r"at scene\.start_us"):
        world_of(start_us)
