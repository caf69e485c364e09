"""Streams as a whole: silence where nothing changes, the same bytes whatever computed them,
events where and of the sign that the scene says, and memory that stays."""

from __future__ import annotations

import copy
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator import EventCamera, World, _core
from evs.emulator.config import CameraConfig, RenderConfig, SensorConfig
from evs.msgs import EvsError
from reference.memory import LEAST_BYTES, resident_bytes

pytestmark = pytest.mark.integration

SMALL = SensorConfig(preset="davis346", width=64, height=48)

STILL = """
<mujoco>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 0" width="32"
      height="192"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .6" width="64"
      height="64"/>
    <material name="floor" texture="tiles" texrepeat="4 4" reflectance=".3"/>
  </asset>
  <worldbody>
    <camera name="tilted" pos="0 -3 1.5" xyaxes="1 .1 0 0 .4 .9"/>
    <camera name="above" pos="0 0 3" projection="orthographic" fovy="4"/>
    <light type="directional" dir=".3 .2 -1"/>
    <light type="spot" pos="1 -1 2" dir="-1 1 -2" cutoff="30" exponent="4"/>
    <geom type="plane" size="3 3 .1" material="floor"/>
    <geom type="box" size=".2 .2 .2" pos="-.6 .5 .2" euler="0 20 30"/>
    <geom type="capsule" size=".1 .25" pos=".5 0 .5" euler="30 40 0"/>
    <geom type="sphere" size=".2" pos="0 -.4 .3"/>
  </worldbody>
</mujoco>
"""


NO_NOISE = {
    "leak_rate_hz": 0.0,
    "photocurrent_pa": 0.0,
    "hot_leak_median_hz": 0.0,
    "parasitic_leak_hz": 0.0,
}


def test_a_still_scene_is_silent_for_a_thousand_ticks() -> None:
    world = World(mujoco.MjModel.from_xml_string(STILL), seed=3)
    free = CameraConfig(lookat=(0, 0, 0.3), distance=3, azimuth=70, elevation=-20)
    for camera, preset, render in (
        ("tilted", "davis346", RenderConfig()),
        ("above", "dvs128", RenderConfig(spp=7)),
        (free, "ideal", RenderConfig(spp=1)),
        # traced anew in every tick: the light itself is the same, not only kept
        ("tilted", "dvxplorer", RenderConfig(spp=2, incremental=False)),
    ):
        # the pixel's own noise is off: what is left answers to light alone
        sensor = SensorConfig(preset, width=33, height=21, **NO_NOISE)
        world.add_camera(camera, sensor=sensor, render=render)
    for packets in world.run(1.0):
        assert all(len(packet.events) == 0 for packet in packets)
    assert world.tick == 1000
    assert not any(camera.is_dark for camera in world.cameras)


def stream_of(path: Path, seed: int = 7, **options: object) -> bytes:
    """The events of 40 ticks of a robot that moves at random, as bytes."""
    threads, render = options.pop("threads", 1), RenderConfig(**{"spp": 2, **options})  # type: ignore[arg-type]
    world = World(path, control="random", seed=seed, threads=threads)  # type: ignore[arg-type]
    world.add_camera(sensor=SMALL, render=render)
    return b"".join(packet.events.tobytes() for (packet,) in world.run(0.04))


def test_a_stream_has_the_same_bytes_whatever_computed_it(robot_files: dict[str, Path]) -> None:
    path = robot_files["gymnasium/humanoid"]
    first = stream_of(path)
    assert len(first) > 16 * 200
    assert stream_of(path) == first
    assert stream_of(path, threads=2) == first
    assert stream_of(path, threads=3, incremental=False) == first
    for isa in _core.isa_available():
        assert stream_of(path, isa=isa) == first
        assert stream_of(path, isa=isa, incremental=False, threads=2) == first
    assert stream_of(path, seed=8) != first


@pytest.mark.parametrize("name", ["gymnasium/humanoid", "gymnasium/ant", "dm_control/cheetah"])
def test_a_users_own_loop_gives_the_worlds_events(name: str, robot_files: dict[str, Path]) -> None:
    world = World(robot_files[name], seed=5)
    camera = world.add_camera(sensor=SMALL)
    model = copy.copy(world.model)
    data = mujoco.MjData(model)
    sensor = EventCamera(model, sensor=SMALL, seed=5)
    assert len(sensor.observe(data)) == 0
    rng, count = np.random.default_rng(0), 0
    for _ in range(60):
        control = rng.uniform(-0.5, 0.5, model.nu)
        (packet,) = world.step(control)
        data.ctrl[:] = control
        for _ in range(world.substeps.count):
            mujoco.mj_step(model, data)
        events = sensor.observe(data)
        assert events.tobytes() == packet.events.tobytes()
        count += len(events)
    np.testing.assert_array_equal(sensor.luminance, camera.luminance)
    assert count > 50


SLIDER = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".2 .2 .2" rgb2=".9 .9 .9" width="512"
      height="512"/>
    <material name="tiles" texture="tiles" texrepeat="1 1" texuniform="true" emission="1"
      specular="0"/>
    <material name="dark" rgba=".3 .3 .3 1" emission="1" specular="0"/>
    <material name="bright" rgba=".9 .9 .9 1" emission="1" specular="0"/>
  </asset>
  <worldbody>
    <camera name="above" pos="0 0 3" projection="orthographic" fovy="2"/>
    <geom type="plane" size="2 2 .1" material="{floor}" rgba="{rgba}"/>
    <body name="slider" mocap="true" pos="0 0 .5">{geom}</body>
  </worldbody>
</mujoco>
"""


def test_a_bright_box_is_on_in_front_and_off_behind() -> None:
    box = '<geom type="box" size=".25 .5 .1" material="bright"/>'
    model = mujoco.MjModel.from_xml_string(SLIDER.format(floor="dark", rgba=".3 .3 .3 1", geom=box))
    data = mujoco.MjData(model)
    width, height, speed = 64, 48, 0.7  # px a tick; 24 px a m
    ideal = SensorConfig("ideal", width=width, height=height, sigma_thres=0.0)
    sensor = EventCamera(model, "above", sensor=ideal, render=RenderConfig(spp=4))
    middle = -12.0  # px from the picture's
    data.mocap_pos[0] = (middle / 24, 0, 0.5)
    sensor.observe(data)
    count = {True: 0, False: 0}
    for tick in range(1, 31):
        middle += speed
        data.mocap_pos[0, 0] = middle / 24
        data.time = tick * 1e-3
        events = sensor.observe(data)
        for on, edge in ((True, middle + 6), (False, middle - 6)):
            x = events["x"][events["p"] == on]
            count[on] += len(x)
            # the edge crossed these pixels in this tick
            low, high = edge - speed + width / 2, edge + width / 2
            assert ((x + 1 > low - 1e-3) & (x < high + 1e-3)).all(), (tick, on, low, high, x)
            # the box is 24 rows high
            y = events["y"][events["p"] == on]
            assert ((y >= 12) & (y < 36)).all()
    # ln(.787 / .073) in linear light is 11.9 thresholds, in each of 24 rows of 21 pixels
    assert count[True] == count[False] == 24 * 21 * 11


def test_a_slow_pan_over_a_checker_gives_events_on_its_edges_only() -> None:
    model = mujoco.MjModel.from_xml_string(
        SLIDER.format(floor="tiles", rgba="1 1 1 1", geom='<geom size=".001" pos="0 0 -9"/>')
    )
    data = mujoco.MjData(model)
    width, height = 60, 48
    view = CameraConfig(body="slider", pos=(0, 0, 3))
    ideal = SensorConfig("ideal", width=width, height=height, sigma_thres=0.0)
    model.vis.global_.orthographic = 1
    model.vis.global_.fovy = 2
    sensor = EventCamera(model, view, sensor=ideal, render=RenderConfig(spp=4))
    sensor.observe(data)
    total = 0
    for tick in range(1, 121):
        # 0.2 px a tick to the right, 0.1 up; 24 px a m
        x, y = 0.2 * tick / 24, 0.1 * tick / 24
        data.mocap_pos[0] = (x, y, 0.5)
        data.time = tick * 1e-3
        events = sensor.observe(data)
        total += len(events)
        # one image a m with two squares a side, so an edge each half metre: 12 px
        across = (events["x"] + 0.5 - width / 2) + 24 * x
        up = -(events["y"] + 0.5 - height / 2) + 24 * y
        off = np.minimum(np.abs(across / 12 - np.round(across / 12)),
                         np.abs(up / 12 - np.round(up / 12))) * 12  # fmt: skip
        # the pixel's half, the filter's pixel, and what moved in this tick
        assert (off <= 0.5 + 1.0 + 0.2).all(), (tick, off.max())
    assert total > 5000


@pytest.mark.slow
def test_memory_does_not_grow_over_twenty_thousand_ticks(robot_files: dict[str, Path]) -> None:
    world = World(robot_files["gymnasium/ant"], control="random", threads=2)
    sensor = SensorConfig("davis346", width=24, height=16)
    world.add_camera(sensor=sensor, render=RenderConfig(spp=1))
    warm, ticks, events = 2_000, 20_000, 0
    stream = world.run((warm + ticks) / 1000)
    for _ in range(warm):
        next(stream)
    before = resident_bytes()
    for (packet,) in stream:
        events += len(packet.events)
    assert events > ticks
    assert resident_bytes() - before < LEAST_BYTES * ticks


def test_an_absurd_number_of_threads_is_an_error_not_a_crash() -> None:
    world = World(mujoco.MjModel.from_xml_string(STILL), threads=10**9)
    with pytest.raises(EvsError, match=r"^threads is 1000000000; give 0 .*"):
        world.add_camera("tilted", sensor=SMALL)
