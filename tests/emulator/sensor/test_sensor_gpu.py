"""Pixels on a GPU give the events and states of the CPU: on the GPU if there is one, else on a
stand-in that runs the same source from the copies that would be uploaded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gpu.stand_in import StandInGpu, stand_in

import evs
from evs.drivers.clock import StopWatch
from evs.emulator.base.gpu.arrays import DeviceLight
from evs.emulator.base.gpu.compiler import SCAN_THREADS
from evs.emulator.base.scene import F32
from evs.emulator.camera import pixel_pipeline
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SensorConfig
from evs.emulator.render.gpu import direct, path
from evs.emulator.sensor import ApsParameters, PlainModel, SensorParameters
from evs.emulator.sensor.gpu import pixel
from evs.emulator.sensor.gpu.pixel import CudaPlainModel
from evs.emulator.sensor.running_mean import RunningMeanConstants
from evs.emulator.simulation.pipelined import PipelinedWorld
from evs.msgs import EvsError
from reference.terms import ALL_TERMS

SWING = Path(__file__).parents[3] / "config/scenes/pendulum.xml"
SENSOR = SensorParameters("test", 39, 11, 0.2, 0.22, 0.03)
TERMS: dict[str, dict[str, Any]] = {
    "ideal": {},
    "log_eps": {"log": "log_eps", "log_eps": 0.01},
    "euler": {"filter": "euler", "cutoff_hz": 200.0, "follower_hz": 800.0},
    "poles": {"cutoff_hz": 200.0, "follower_hz": 800.0, "highpass_hz": 3.0, "leak_rate_hz": 30.0},
    "silicon": {"log": "ln", "filter": "large_signal", **ALL_TERMS},
    "spread": {"refractory_period_s": 0.0005, "refractory_spread_decades": 0.2},
    "photons": {
        "log": "ln",
        "dark_lux": 0.1,
        "cutoff_hz": 300.0,
        "follower_hz": 900.0,
        "photocurrent_pa": 0.5,
        "leak_rate_hz": 5.0,
        "shot_noise_rate_hz": 100.0,
        "refractory_period_s": 0.0003,
    },
    "frames": {
        "dark_lux": 0.1,
        "leak_rate_hz": 2.0,
        "photocurrent_pa": 0.5,
        "follower_hz": 900.0,
        "aps": ApsParameters(enabled=True, rate_hz=100.0, exposure_us=2000, crosstalk=0.02),
    },
}
AVERAGES = {"plain": None, "adaptive": RunningMeanConstants()}


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> StandInGpu | None:
    """The stand-in; None: there is a GPU."""
    return stand_in(monkeypatch, direct, path, pixel)


def film(seed: int, ticks: int) -> list[F32]:
    """Light that stands in half of the image and changes in the other, steps, and what is no
    light."""
    rng = np.random.default_rng(seed)
    light = rng.uniform(0.02, 1.0, (SENSOR.height, SENSOR.width)).astype(np.float32)
    frames = []
    for tick in range(ticks):
        if tick % 3 != 2:
            light[:, ::2] *= np.exp(rng.normal(0.0, 0.15, light[:, ::2].shape)).astype(np.float32)
        if tick == ticks // 2:
            light *= np.float32(30.0)
        if tick % 5 == 4:
            light[rng.integers(SENSOR.height), rng.integers(SENSOR.width)] = (np.nan, -1.0)[
                tick % 2
            ]
        frames.append(light.copy())
        light = np.where(light > 0.0, light, np.float32(0.5))
    return frames


@pytest.mark.parametrize("average", AVERAGES)
@pytest.mark.parametrize("name", TERMS)
def test_events_and_states_are_those_of_the_cpu(
    device: StandInGpu | None, name: str, average: str
) -> None:
    sensor = replace(SENSOR, **TERMS[name])
    options = {"average": AVERAGES[average], "causes": name == "silicon"}
    cpu, there = PlainModel(sensor, 1, **options), CudaPlainModel(sensor, 1, **options)
    ours, theirs = there.init(7), cpu.init(7)
    now, seen = -400, 0
    for tick, light in enumerate(film(len(name), 24)):
        # ticks of other lengths in between
        end = now + (1000, 1000, 350)[tick % 7 // 3]
        events, ours = there.step(light, ours, now, end)
        expected, theirs = cpu.step(light, theirs, now, end)
        assert events.tobytes() == expected.tobytes(), tick
        now, seen = end, seen + len(events)
        if tick % 6 == 5:
            assert ours.fetched() == theirs, tick
            assert ours.clamps == theirs.clamps
        if tick == 11:
            # each goes on on the other machine
            ours, theirs = there.restore(theirs.save()), cpu.restore(ours.save())
        if tick == 15 and "leak_rate_hz" in TERMS[name]:
            changed = replace(sensor, pos_thres=0.15, leak_rate_hz=40.0)
            cpu_now, there_now = (
                model(changed, 1, **options) for model in (PlainModel, CudaPlainModel)
            )
            ours, theirs = there_now.take_over(ours, there), cpu_now.take_over(theirs, cpu)
            cpu, there = cpu_now, there_now
    assert seen > 500


def test_a_burst_gets_room(device: StandInGpu | None) -> None:
    """More events of a block, of a tick, and more candidates of noise than there was room for."""
    sensor = replace(
        SENSOR, pos_thres=0.002, neg_thres=0.002, sigma_thres=0.0, shot_noise_rate_hz=2e4
    )
    cpu, there = PlainModel(sensor, 1), CudaPlainModel(sensor, 1)
    ours, theirs = there.init(1), cpu.init(1)
    shape = SENSOR.height, SENSOR.width
    sizes = []
    for tick, light in enumerate((0.1, 0.2, 0.2, 9.0, 0.2, 0.2)):
        grey = np.full(shape, light, np.float32)
        span = 1000 * tick, 1000 * tick + 1000
        events, ours = there.step(grey, ours, *span)
        expected, theirs = cpu.step(grey, theirs, *span)
        assert events.tobytes() == expected.tobytes()
        assert ours.fetched() == theirs
        sizes.append(len(events))
    assert max(sizes) > pixel.LEAST_ROOM * 10
    assert sizes[-1] < max(sizes) / 10


def test_large_images_are_packed_in_parts(device: StandInGpu | None) -> None:
    """More blocks than a scan has threads: each thread has several."""
    sensor = replace(SENSOR, width=257, height=257)
    assert sensor.width * sensor.height > pixel.BLOCK * SCAN_THREADS
    cpu, there = PlainModel(sensor, 1), CudaPlainModel(sensor, 1)
    ours, theirs = there.init(2), cpu.init(2)
    rng = np.random.default_rng(2)
    for tick in range(4):
        light = rng.uniform(0.05, 1.0, (sensor.height, sensor.width)).astype(np.float32)
        light[tick::50, ::7] = np.nan
        span = 1000 * tick, 1000 * tick + 1000
        events, ours = there.step(light, ours, *span)
        expected, theirs = cpu.step(light, theirs, *span)
        assert events.tobytes() == expected.tobytes()
        assert ours.fetched() == theirs
    assert len(events) > 100_000
    assert ours.clamps > 500


def worlds(model: str, render: dict[str, Any], sensor: SensorConfig) -> list[evs.World]:
    """The same world with its pixels on the CPU and on a GPU."""
    made = []
    for where in ("cpu", "cuda"):
        world = evs.World(SWING, seed=3)
        world.add_camera(
            CameraConfig(distance=2.0),
            sensor=sensor,
            render=RenderConfig(**{**render, "device": where}),
            model=ModelConfig(name=model, device=where),
        )
        made.append(world)
    return made


@pytest.mark.parametrize(
    ("model", "render"),
    [("plain", {}), ("adaptive", {"renderer": "path", "spp": 2, "seeds": "fresh"})],
    ids=["plain", "adaptive"],
)
def test_light_stays_on_the_gpu(
    device: StandInGpu | None, model: str, render: dict[str, Any]
) -> None:
    """It is downloaded where somebody looks at it, and packets and frames are those of the CPU."""
    if device:
        device.shape = 24, 32
    sensor = SensorConfig(preset="davis346", width=32, height=24)
    cpu, there = worlds(model, render, sensor)
    seen = 0
    for tick in range(40):
        (one,), (other,) = cpu.step(), there.step()
        assert other.events.tobytes() == one.events.tobytes(), tick
        seen += len(other.events)
        if tick % 10 == 3:
            assert there.cameras[0].luminance.tobytes() == cpu.cameras[0].luminance.tobytes()
            assert there.cameras[0].is_dark == cpu.cameras[0].is_dark
        frames = [world.cameras[0].frames for world in (cpu, there)]
        assert [f.image.tobytes() for f in frames[0]] == [f.image.tobytes() for f in frames[1]]
    assert seen > 50
    assert isinstance(there.cameras[0]._luminance, DeviceLight)
    # each goes on from the state of the other
    states = cpu.save(), there.save()
    cpu.restore(states[1])
    there.restore(states[0])
    for _ in range(10):
        (one,), (other,) = cpu.step(), there.step()
        assert other.events.tobytes() == one.events.tobytes()
    for world in (cpu, there):
        world.reset(seed=5)
    (one,), (other,) = cpu.step(), there.step()
    assert other.events.tobytes() == one.events.tobytes()


def test_light_that_is_made_ahead_stays_there_too(device: StandInGpu | None) -> None:
    if device:
        device.shape = 24, 32
    ticks = 40
    packets = []
    for world in worlds("plain", {}, SensorConfig(preset="davis346", width=32, height=24)):
        ahead = PipelinedWorld(world, ticks, StopWatch(), 3)
        packets.append([ahead.step()[0].events.tobytes() for _ in range(ticks)])
        ahead.close()
    assert isinstance(world.cameras[0]._luminance, DeviceLight)
    assert packets[0] == packets[1]
    assert len(b"".join(packets[0])) > 1000


def test_light_of_the_cpu_is_uploaded(device: StandInGpu | None) -> None:
    cpu, there = worlds("plain", {}, SensorConfig(preset="ideal", width=32, height=24))
    if device:
        device.shape = 24, 32
    there = evs.World(SWING, seed=3)
    there.add_camera(
        CameraConfig(distance=2.0),
        sensor=SensorConfig(preset="ideal", width=32, height=24),
        model=ModelConfig(device="cuda"),
    )
    for _ in range(60):
        (one,), (other,) = cpu.step(), there.step()
        assert other.events.tobytes() == one.events.tobytes()


def test_what_a_gpu_cannot_do_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pixel_pipeline, "why_no_gpu", lambda: "there is no GPU")
    world = evs.World(SWING)
    for config, says in (
        (ModelConfig(device="cuda"), "model.device is cuda, but there is no GPU; take cpu"),
        (ModelConfig(device="gpu"), "model.device"),
    ):
        with pytest.raises(EvsError, match=says):
            world.add_camera(CameraConfig(distance=2.0), model=config)
    world.add_camera(CameraConfig(distance=2.0), model=ModelConfig(device="auto"))
