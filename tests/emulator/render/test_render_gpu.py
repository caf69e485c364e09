"""Renderers on a GPU have the bytes of the CPU: on the GPU if there is one, else on a stand-in that
runs the CPU's kernels on what would be uploaded."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gpu.stand_in import StandInGpu, stand_in

import evs
from evs.emulator import _core
from evs.emulator.base.arrays import same_bytes
from evs.emulator.base.gpu import driver
from evs.emulator.base.protocols import DeviceRenderer, Renderer
from evs.emulator.base.scene import CameraPose
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.render.gpu import direct, hybrid, path
from evs.emulator.render.seed_cycle import CycleRenderer
from evs.msgs import EvsError
from reference.random_scenes import RandomStage

SWING = Path(__file__).parents[3] / "config/scenes/pendulum.xml"


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> StandInGpu | None:
    """The stand-in, which must be told the image's shape; None: a GPU renders."""
    return stand_in(monkeypatch, direct, hybrid, path)


def on_device(device: StandInGpu | None, stage: RandomStage, **render: Any) -> Renderer:
    """The renderer of a stage on the device."""
    if device:
        device.shape = stage.camera.height, stage.camera.width
    made = stage.renderer(device="cuda", **render)
    assert isinstance(made, DeviceRenderer | CycleRenderer)
    return made


@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
@pytest.mark.parametrize("seed", range(12))
def test_light_is_that_of_the_cpu(device: StandInGpu | None, seed: int, antialiasing: str) -> None:
    """Scenes of everything: materials, maps, sky, fog, haze, lenses, lamps that pulse, and many
    geoms."""
    many = 150 if seed % 4 == 3 else None
    stage = RandomStage(seed, rich=seed % 2 == 0, many=many)
    render = {"spp": (1, 4)[seed % 2] if antialiasing == "fixed" else 4}
    cpu = stage.renderer(antialiasing=antialiasing, **render)
    there = on_device(device, stage, antialiasing=antialiasing, **render)
    for tick, (frame, pose) in enumerate(stage.film(4)):
        expected = cpu.render(frame, pose).copy()
        assert there.render(frame, pose).tobytes() == expected.tobytes(), tick
        into = np.empty_like(expected)
        assert there.render(frame, pose, into) is into
        assert into.tobytes() == expected.tobytes()


@pytest.mark.parametrize("seeds", ["fixed", "fresh", "cycle"])
@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 2))])
def test_paths_are_those_of_the_cpu(
    device: StandInGpu | None, seed: int, seeds: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bulbs, glowing geoms, sky, gloss, glass, fog and haze; more samples than there is room for
    at once, and than are added up in one sum."""
    stage = RandomStage(seed, rich=seed % 2 == 0, bulbs=True, size=(17, 10))
    render = {"renderer": "path", "spp": (70, 5)[seed % 2], "seeds": seeds, "bounces": 1 + seed}
    monkeypatch.setattr(path, "MOST_BYTES", 3 * 17 * 10 * 4 * 30)
    cpu = stage.renderer(**render)
    there = on_device(device, stage, **render)
    for tick, (frame, pose) in enumerate(stage.film(3)):
        expected = cpu.render(frame, pose).copy()
        assert there.render(frame, pose).tobytes() == expected.tobytes(), tick


@pytest.mark.slow
@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_soft_light_is_that_of_the_cpu(
    device: StandInGpu | None, seed: int, antialiasing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over a sweep of the cache, with a state that goes on elsewhere, and lists that are too short
    for what a pass misses."""
    monkeypatch.setattr(hybrid, "LEAST_MISSING", 8)
    many = 40 if seed == 1 else None
    stage = RandomStage(seed, rich=seed % 2 == 0, bulbs=True, many=many, size=(17, 5))
    render = {"renderer": "hybrid", "spp": (1, 4)[seed % 2] if antialiasing == "fixed" else 4}
    cpu = stage.renderer(antialiasing=antialiasing, **render)
    there = on_device(device, stage, antialiasing=antialiasing, **render)
    film = stage.film(70)
    for tick, (frame, pose) in enumerate(film):
        expected = cpu.render(frame, pose).copy()
        assert there.render(frame, pose).tobytes() == expected.tobytes(), tick
        if tick % 23 == 0:
            assert same_bytes(cpu.save(), there.save())
    cpu.prepare_restore(there.save())()
    there.restart()
    there.prepare_restore(cpu.save())()
    frame, pose = film[30]
    expected = cpu.render(frame, pose).copy()
    assert there.render(frame, pose).tobytes() == expected.tobytes()
    assert there.render_again(frame, pose).tobytes() == expected.tobytes()


@pytest.mark.slow
def test_soft_light_at_rest_and_of_a_full_cache(
    device: StandInGpu | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_core, "Tracing", partial(_core.Tracing, nodes=150))
    stage = RandomStage(5, rich=True, bulbs=True, size=(17, 10))
    cpu = stage.renderer(renderer="hybrid")
    there = on_device(device, stage, renderer="hybrid")
    film = stage.film(12)
    for tick, (frame, pose) in enumerate([*film, *[film[-1]] * 210, film[0]]):
        expected = cpu.render(frame, pose).copy()
        assert there.render(frame, pose).tobytes() == expected.tobytes(), tick
        rested = there.traced_fraction == 0
        assert rested == (cpu.traced_fraction == 0)
        if tick == 221:
            assert rested
    assert same_bytes(cpu.save(), there.save())
    assert cpu.save()["coarser"] > 0


def test_what_stays_is_uploaded_once(device: StandInGpu | None) -> None:
    if device is None:
        pytest.skip("only a stand-in counts")
    stage = RandomStage(2, rich=True)
    there = on_device(device, stage)
    (frame, pose) = stage.film(1)[0]
    constant = device.uploaded
    there.render(frame, pose)
    tick = device.uploaded - constant
    there.render(frame, pose)
    assert device.uploaded == constant + 2 * tick
    assert tick < constant


def test_events_are_those_of_the_cpu(device: StandInGpu | None) -> None:
    """With a lens and vignetting, and of a saved state that goes on elsewhere."""
    if device:
        device.shape = 24, 32
    sensor = evs.SensorConfig(preset="davis346", width=32, height=24)
    lens = CameraConfig(
        distance=2.0, distortion_model="plumb_bob", distortion=(0.1, 0, 0, 0, 0), vignetting="cos4"
    )
    worlds = [evs.World(SWING, seed=3) for _ in range(2)]
    for world, where in zip(worlds, ("cpu", "cuda"), strict=True):
        world.add_camera(lens, sensor=sensor, render=RenderConfig(device=where))
    seen = 0
    for tick in range(60):
        (one,), (other,) = (world.step() for world in worlds)
        assert one.events.tobytes() == other.events.tobytes(), tick
        seen += len(one.events)
    assert seen > 100
    worlds[0].restore(worlds[1].save())
    (one,), (other,) = (world.step() for world in worlds)
    assert one.events.tobytes() == other.events.tobytes()


def test_worlds_on_a_gpu_are_stepped_one_by_one(device: StandInGpu | None) -> None:
    if device:
        device.shape = 24, 32
    sensor = evs.SensorConfig(preset="ideal", width=32, height=24)
    seen = []
    for where in ("cpu", "cuda"):
        worlds = evs.Worlds(SWING, 2, threads=1)
        render = RenderConfig(device=where, antialiasing="fixed")
        worlds.add_camera(CameraConfig(distance=2.0), sensor=sensor, render=render)
        (events,) = worlds.step(ticks=60)
        seen.append(events.events.tobytes())
    assert "light and pixels are not both on a GPU" in worlds.one_by_one
    assert seen[0] == seen[1] != b""


def test_a_view_without_surfaces_is_traced_on_the_device(device: StandInGpu | None) -> None:
    """And as soon as it shows one the cache is filled as on the CPU."""
    stage = RandomStage(0, rich=True, size=(17, 10))
    cpu, there = stage.renderer(renderer="hybrid"), on_device(device, stage, renderer="hybrid")
    film = list(stage.film(4))
    away = CameraPose(film[0][1].pos + 1e4, film[0][1].mat)
    for pose in (away, away, film[2][1], film[3][1]):
        before = cpu.work["cache_nodes"]
        expected = cpu.render(film[0][0], pose).copy()
        filled = before == 0 < cpu.work["cache_nodes"]
        assert there.render(film[0][0], pose).tobytes() == expected.tobytes()
        assert there._device.is_fetched or not filled
    assert same_bytes(cpu.save(), there.save())


@pytest.mark.parametrize(
    ("render", "says"),
    [
        ({"renderer": "raster"}, "a GPU renders direct and hybrid and path only"),
        ({"renderer": "path", "antialiasing": "adaptive", "spp": 4}, "paths at edges only"),
        ({"device": "gpu"}, "render.device"),
    ],
)
def test_what_a_gpu_cannot_do_is_refused(render: dict[str, Any], says: str) -> None:
    stage = RandomStage(1)
    with pytest.raises(EvsError, match=says):
        stage.renderer(**{"device": "cuda", **render})


def test_colour_stays_on_the_cpu() -> None:
    stage = RandomStage(1)
    config = RenderConfig(device="cuda")
    with pytest.raises(EvsError, match="colour is rendered on the CPU only; take cpu, or auto"):
        make_renderer(stage.scene, stage.camera, config, 1, rgb=True)
    auto = make_renderer(stage.scene, stage.camera, replace(config, device="auto"), 1, rgb=True)
    assert not isinstance(auto, DeviceRenderer)


def test_a_forked_process_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver, "_why_no_gpu", lambda: "")
    monkeypatch.setattr(driver, "_process", [os.getppid()])
    assert "start processes with spawn" in driver.why_no_gpu()
    with pytest.raises(EvsError, match="nothing can be rendered on a GPU: CUDA was started"):
        driver.the_gpu()


def test_a_machine_without_a_gpu_says_so() -> None:
    reason = driver.why_no_gpu()
    if not reason:
        pytest.skip("there is one")
    stage = RandomStage(1)
    with pytest.raises(EvsError, match=r"render.device is cuda, but .*; take cpu, or auto"):
        stage.renderer(device="cuda")
    assert not isinstance(stage.renderer(device="auto"), DeviceRenderer)
