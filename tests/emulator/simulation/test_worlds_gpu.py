"""Worlds whose cameras are on a GPU: one launch for all of them, with the bytes of worlds alone on
the CPU. Without a GPU, a stand-in runs the same source from what would be uploaded."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from gpu.stand_in import StandInGpu, stand_in

from evs.emulator import World, Worlds
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from evs.emulator.render.gpu import direct, path
from evs.emulator.sensor.gpu import pixel
from evs.emulator.simulation import device_batch
from reference.worlds_alone import SWING, Alone, assert_same_states, change_both, step_both

READ_OUT = SensorConfig("dvs128", width=40, height=32)
NOISY = SensorConfig("davis346", width=40, height=32)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> StandInGpu | None:
    """The stand-in; None: there is a GPU."""
    made = stand_in(monkeypatch, direct, path, pixel, device_batch)
    if made:
        made.shape = 32, 40
    return made


def pairs(
    count: int, sensor: SensorConfig = NOISY, cameras: tuple[str, ...] = ("left",), **model: Any
) -> tuple[Worlds, Alone]:
    """Swings on the GPU, and the same ones alone on the CPU, pushed."""
    scene = mujoco.MjModel.from_xml_string(SWING)

    def described(device: str) -> list[dict[str, Any]]:
        render, pixels = (
            RenderConfig(device=device, antialiasing="fixed"),
            ModelConfig(device=device, **model),
        )
        each = {"sensor": sensor, "render": render, "model": pixels}
        return [{"camera": camera, **each} for camera in cameras]

    worlds = Worlds(scene, count, seed=3, threads=2, control="random")
    for camera in described("cuda"):
        worlds.add_camera(**camera)
    alone = Alone(worlds, scene, described("cpu"), control="random")

    def push(number: int, world: World) -> None:
        world.data.qvel[:] = 4.0 + 0.7 * number

    change_both(worlds, alone, push)
    assert worlds.one_by_one == ""
    return worlds, alone


@pytest.mark.parametrize(
    ("sensor", "cameras", "model"),
    [
        (NOISY, ("left",), {}),
        (READ_OUT, ("left", "right"), {}),
        (NOISY, ("right",), {"name": "adaptive"}),
    ],
    ids=["noise", "two cameras, a readout", "adaptive"],
)
def test_each_world_gives_the_bytes_of_a_world_alone(
    device: StandInGpu | None, sensor: SensorConfig, cameras: tuple[str, ...], model: dict[str, str]
) -> None:
    worlds, alone = pairs(4, sensor, cameras, **model)
    assert step_both(worlds, alone, ticks=6) > 0
    assert_same_states(worlds, alone)
    step_both(worlds, alone, ticks=[3, 0, 1, 5])
    assert_same_states(worlds, alone)
    # some are set back, and go on from what they were
    saved = worlds.save()
    step_both(worlds, alone, ticks=2)
    worlds.restore(saved)
    for world, state in zip(alone.each, saved, strict=True):
        world.restore(state)
    step_both(worlds, alone, ticks=3)
    assert_same_states(worlds, alone)


def test_each_world_has_its_own_light(device: StandInGpu | None) -> None:
    """Some of it coloured, which takes other kernels."""
    worlds, alone = pairs(4)
    step_both(worlds, alone, ticks=2)
    lamp = {
        "light.lamp.diffuse.r": 0.2,
        "light.lamp.diffuse.g": 0.9,
        "light.lamp.diffuse.b": 0.4,
    }
    scenes = [{}, lamp, {"light.lamp.brightness": 0.5}, {**lamp, "light.lamp.pos.x": 0.5}]
    worlds.reset(seed=5, scene=scenes)
    for number, (world, scene) in enumerate(zip(alone.each, scenes, strict=True)):
        world.reset(seed=worlds.seeds[number], scene=scene)
    assert step_both(worlds, alone, [[1.0], [-1.0], [0.5], [1.0]], ticks=20) > 0
    assert_same_states(worlds, alone)
    step_both(worlds, alone, ticks=[2, 0, 3, 1])
    assert_same_states(worlds, alone)


def test_worlds_are_placed_while_others_are_rendered(
    device: StandInGpu | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_batch, "AT_ONCE", 2)
    sensor = SensorConfig("ideal", width=40, height=32, pos_thres=0.01, neg_thres=0.01)
    worlds, alone = pairs(5, sensor)
    assert step_both(worlds, alone, ticks=3) > 5 * pixel.BLOCK
    assert step_both(worlds, alone, ticks=[2, 0, 1, 3, 2]) > 0
    assert_same_states(worlds, alone)


def test_a_burst_of_all_worlds_gets_room(device: StandInGpu | None) -> None:
    sensor = SensorConfig(
        "ideal", width=40, height=32, pos_thres=0.002, neg_thres=0.002, shot_noise_rate_hz=5e3
    )
    worlds, alone = pairs(3, sensor)
    assert step_both(worlds, alone, ticks=4) > 16 * 4 * pixel.LEAST_ROOM
    assert_same_states(worlds, alone)


def test_light_that_is_none_is_counted_where_it_is(
    device: StandInGpu | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if device is None:
        pytest.skip("no scene has such light: only a stand-in can make it")
    worlds, _ = pairs(3)
    worlds.step(ticks=2)
    traced = 0

    def trace(arguments: object, luminance: np.ndarray) -> None:
        nonlocal traced
        luminance[:] = 0.5
        luminance[: traced % 3] = np.nan
        traced += 1

    monkeypatch.setattr("gpu.stand_in._core.trace_device_frame", trace)
    worlds.step(ticks=2)
    assert [worlds.world(number).cameras[0].clamps for number in range(3)] == [0, 80, 160]


def test_what_does_not_fit_together_goes_one_by_one(device: StandInGpu | None) -> None:
    worlds = Worlds(mujoco.MjModel.from_xml_string(SWING), 2)
    there = {
        "render": RenderConfig(device="cuda", antialiasing="fixed"),
        "model": ModelConfig(device="cuda"),
    }
    worlds.add_camera("left", sensor=NOISY, **there)
    worlds.add_camera("right", sensor=NOISY)
    assert "differ in size or device" in worlds.one_by_one
    worlds = Worlds(mujoco.MjModel.from_xml_string(SWING), 2)
    edges = RenderConfig(device="cuda", antialiasing="adaptive", spp=4)
    worlds.add_camera("left", sensor=NOISY, render=edges, model=ModelConfig(device="cuda"))
    assert "camera by camera" in worlds.one_by_one
