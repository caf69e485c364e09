"""EvSNet on a GPU has the bytes of the CPU: on the GPU if there is one, else on a stand-in that
runs the code of its threads on what would be uploaded."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from gpu.stand_in import stand_in

import evs
from evs.emulator.base.gpu import driver
from evs.emulator.base.gpu.arrays import DeviceLight
from evs.emulator.base.gpu.compiler import SCAN_THREADS
from evs.emulator.base.scene import F32
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import CameraConfig, ModelConfig
from evs.emulator.evsnet import NetworkWeights
from evs.emulator.evsnet.gpu import model as gpu_model
from evs.emulator.evsnet.gpu import network as gpu_network
from evs.emulator.evsnet.gpu.model import CudaEvsNetModel
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.networks import random_network, through_network

SWING = Path(__file__).parents[3] / "config/scenes/pendulum.xml"
Saved = dict[str, npt.NDArray[Any]]
Pair = tuple[EvsNetModel, CudaEvsNetModel]


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The GPU, or the stand-in."""
    return stand_in(monkeypatch, gpu_model) or driver.the_gpu()


def film(seed: int, ticks: int, height: int, width: int) -> F32:
    """A part that never moves, one that moves in bursts, large steps, and light that is none."""
    rng = np.random.default_rng(seed)
    frame = np.exp(rng.normal(-2, 2, (height, width)))
    still = rng.random((height, width)) < 0.4
    out = np.empty((ticks, height, width), np.float32)
    rests = 0
    for k in range(ticks):
        if rests == 0:
            moves = ~still & (rng.random(frame.shape) < rng.choice([0.02, 0.9]))
            step = np.exp(rng.normal(0, rng.choice([0.3, 4.0]), frame.shape))
            frame = np.where(moves, np.clip(frame * step, 1e-6, 1e6), frame)
            rests = int(rng.choice([0, 0, 0, 1, 25, 60]))
        rests -= rests > 0
        out[k] = frame
        if rng.random() < 0.1:
            bad = [np.nan, -1.0, np.inf, -np.inf, 0.0, -0.0, 1e9, 1e-42, 3e38]
            out[k][rng.random(frame.shape) < 0.1] = rng.choice(bad)
    return out


def pair(weights: NetworkWeights, shape: tuple[int, int], on: float = 0.15, **options: Any) -> Pair:
    """The model on the CPU and on the device."""
    sensor = SensorParameters("test", shape[1], shape[0], on, 0.3)
    cpu = EvsNetModel(sensor, weights, threads=2, **options)
    return cpu, CudaEvsNetModel(sensor, weights, **options)


def drawn(seed: int) -> tuple[NetworkWeights, tuple[int, int], dict[str, Any]]:
    """A network, the size of an image, and options."""
    rng = np.random.default_rng(seed)
    weights = random_network(
        seed,
        int(rng.choice([1, 2, 3, 4, 5, 7, 8, 9, 13, 16])),
        int(rng.integers(0, 4)),
        biased=seed % 3 == 2,
        look_ahead=int(rng.integers(0, 7)) // 2,
    )
    shape = int(rng.integers(1, 14)), int(rng.integers(1, 38))
    return (
        weights,
        shape,
        {"sparse": seed % 2 == 0, "events_per_tick": ("one", "many")[seed // 2 % 2]},
    )


def same_pixels(one: Saved, other: Saved) -> None:
    """The states are the same but for which row of memory a tile has."""
    for name in one:
        if name not in ("fifo", "tile_row"):
            assert one[name].tobytes() == other[name].tobytes(), name


@pytest.mark.parametrize("seed", range(16))
def test_events_and_states_are_those_of_the_cpu(
    device: Any, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpu_network, "LEAST_ROOM", 1)
    weights, shape, options = drawn(seed)
    cpu, gpu = pair(weights, shape, **options)
    here, there = cpu.init(seed), gpu.init(seed)
    light = film(seed, 100, *shape)
    for first, last in ((0, 1), (1, 40), (40, 43), (43, 100)):
        expected, here = cpu.step_chunk(light[first:last], here, 1000 * first, 1000)
        found, there = gpu.step_chunk(light[first:last], there, 1000 * first, 1000)
        assert [tick.tobytes() for tick in found] == [tick.tobytes() for tick in expected]
        assert there.clamps == here.clamps
        one, other = here.save(), there.save()
        same_pixels(one, other)
        if not options["sparse"]:
            assert other["fifo"].tobytes() == one["fifo"].tobytes()
            assert other["tile_row"].tobytes() == one["tile_row"].tobytes()
    assert here.clamped > 0


@pytest.mark.slow
def test_films_have_what_is_compared(device: Any) -> None:
    """Spikes in numbers, saturation, and clamps of each kind."""
    most, clamps = 0, np.zeros(3, np.int64)
    for seed in range(16):
        weights, shape, options = drawn(seed)
        _, gpu = pair(weights, shape, **options)
        events, state = gpu.step_chunk(film(seed, 100, *shape), gpu.init(seed), 0, 1000)
        for tick in events:
            pixels = tick["y"].astype(np.int64) * shape[1] + tick["x"]
            most = max(most, int(np.bincount(pixels).max(initial=0)))
        now = state.numbers
        clamps += (now.clamped, now.x_clamped, now.v_clamped)
    assert most == 64
    assert np.all(clamps > 100)


def test_large_images_are_counted_in_parts(device: Any) -> None:
    """More groups than a scan has threads: each thread has several."""
    shape = 181, 257
    assert shape[0] * shape[1] > 32 * SCAN_THREADS
    cpu, gpu = pair(through_network(5.0, 0), shape, events_per_tick="many")
    light = np.random.default_rng(1).uniform(0.05, 1, (6, *shape)).astype(np.float32)
    light[4] = light[3]
    expected, here = cpu.step_chunk(light, cpu.init(1), 0, 1000)
    found, there = gpu.step_chunk(light, gpu.init(1), 0, 1000)
    assert [tick.tobytes() for tick in found] == [tick.tobytes() for tick in expected]
    assert len(found[-1]) > 20_000
    same_pixels(here.save(), there.save())


@pytest.mark.parametrize("seed", [0, 3, 5, 6])
def test_currents_are_those_of_the_cpu(device: Any, seed: int) -> None:
    weights, shape, options = drawn(seed)
    cpu, gpu = pair(weights, shape, **options)
    here, there = cpu.init(seed), gpu.init(seed)
    light = film(seed, 60, *shape)
    expected, found = np.full_like(light, 7), np.full_like(light, 7)
    for first in (0, 30):
        cpu.runtime.step(
            light[first : first + 30], here, 1000 * first, expected[first : first + 30]
        )
    for tick, frame in enumerate(light):
        gpu._there.step(frame, there, 1000 * tick, found[tick])
    assert found.tobytes() == expected.tobytes()
    assert np.count_nonzero(found) > 100


@pytest.mark.parametrize("ticks", [0, 2**41 + 3])
@pytest.mark.parametrize("seed", [0, 1, 2, 4, 8])
def test_a_saved_state_goes_on_elsewhere(device: Any, seed: int, ticks: int) -> None:
    """From machine to machine, with and without tiles that are left out; also in late hours."""
    weights, shape, options = drawn(seed)
    cpu, gpu = pair(weights, shape, **options)
    still = {"sparse": False, "events_per_tick": options["events_per_tick"]}
    models = [gpu, cpu, *pair(weights, shape, **still)[::-1], gpu]
    light = film(seed + 100, 150, *shape)
    start = cpu.init(seed).save()
    start["ticks"] = np.array(ticks)
    begin_us = 1000 * ticks % 2**50
    expected, alone = cpu.step_chunk(light, cpu.restore(start), begin_us, 1000)
    saved, found = start, []
    for model, part in zip(models, np.array_split(np.arange(150), 5), strict=True):
        state = model.restore(saved)
        at_us = begin_us + 1000 * int(part[0])
        events, state = model.step_chunk(light[part[:11]], state, at_us, 1000)
        found += events
        # saving changes nothing
        state.save()
        events, state = model.step_chunk(light[part[11:]], state, at_us + 11_000, 1000)
        found += events
        saved = state.save()
    assert [tick.tobytes() for tick in found] == [tick.tobytes() for tick in expected]
    same_pixels(saved, alone.save())


def test_still_pixels_are_not_saved(device: Any) -> None:
    """The rows of tiles that rest are left out, once nothing of their X is left."""
    cpu, gpu = pair(random_network(1), (40, 60))
    light = np.full((60, 40, 60), 0.5, np.float32)
    light[5:, 21, 33] = 0.7
    state = gpu.init(1)
    rows = []
    for tick in range(60):
        _, state = gpu.step(light[tick], state, 1000 * tick, 1000 * tick + 1000)
        rows.append(int(state.save()["tile_row"].max()) + 1)
    # 6 ticks of each of 7 convolutions
    assert rows == [0] * 5 + [1] * 42 + [0] * 13
    assert state.save()["v"].tobytes() == cpu.step_chunk(light, cpu.init(1), 0, 1000)[1].v.tobytes()


def test_a_state_is_a_value(device: Any) -> None:
    """Two states of one model do not touch each other; a copy and a new start have the bytes."""
    weights, shape, options = drawn(4)
    _, gpu = pair(weights, shape, **options)
    light = film(1, 50, *shape)
    first, state = gpu.step_chunk(light, gpu.init(9), 0, 1000)
    half, other = gpu.step_chunk(light[:30], gpu.init(9), 0, 1000)
    copy = other.copy()
    for again in (other, copy):
        rest, _ = gpu.step_chunk(light[30:], again, 30_000, 1000)
        joined = [tick.tobytes() for tick in half + rest]
        assert joined == [tick.tobytes() for tick in first]
        assert again.fetched() == state.fetched()


def test_thresholds_can_be_adjusted(device: Any) -> None:
    weights, shape, options = drawn(6)
    light = film(3, 90, *shape)
    found: list[list[bytes]] = []
    for which in range(2):
        model = pair(weights, shape, **options)[which]
        state: Any = model.init(2)
        events = []
        for first, threshold in ((0, 0.15), (30, 0.05), (60, 0.4)):
            other = pair(weights, shape, threshold, **options)[which]
            state, model = other.take_over(state, model), other
            ticks, state = model.step_chunk(light[first : first + 30], state, 1000 * first, 1000)
            events += [tick.tobytes() for tick in ticks]
        found.append([*events, state.save()["v"].tobytes(), state.save()["tile_loud"].tobytes()])
    assert found[0] == found[1]


def test_denormals_are_flushed(device: Any) -> None:
    """A current below 2^-126 is none: the pixel is not active, there as here."""
    weights = through_network(1e-20, 0)
    weights.encoder.weight[:] *= np.float32(1e-20)
    light = np.random.default_rng(1).uniform(0.1, 1, (9, 4, 4)).astype(np.float32)
    for gain in (1e-20, 1.0):
        weights = through_network(gain, 0)
        weights.encoder.weight[:] *= np.float32(1e-20)
        cpu, gpu = pair(weights, (4, 4))
        saved = [model.step_chunk(light, model.init(1), 0, 1000)[1].save() for model in (cpu, gpu)]
        same_pixels(*saved)
        assert np.all(saved[0]["tile_moved"] == 8)
        assert np.all(saved[1]["last"] == (0 if gain < 1 else 8))


def test_light_that_is_there_stays_there(device: Any) -> None:
    weights, shape, options = drawn(0)
    cpu, gpu = pair(weights, shape, **options)
    here, there = cpu.init(1), gpu.init(1)
    light = DeviceLight(device, shape)
    for tick, frame in enumerate(film(2, 60, *shape)):
        device.upload(light.memory, frame)
        device.wait()
        light.changed()
        expected, here = cpu.step(frame, here, 1000 * tick, 1000 * tick + 1000)
        found, there = gpu.step(light, there, 1000 * tick, 1000 * tick + 1000)
        assert found.tobytes() == expected.tobytes()
    assert light._here is None
    with pytest.raises(EvsError, match=r"luminance is \(1, 1\), the sensor"):
        gpu.step(DeviceLight(device, (1, 1)), there, 60_000, 61_000)


def packets(device: str, chunk: int, ticks: int = 60) -> tuple[list[bytes], evs.World]:
    sensor = evs.SensorConfig(preset="davis346", width=32, height=24)
    world = evs.World(SWING, seed=3)
    config = ModelConfig(name="evsnet", network="evsnet_c8", chunk=chunk, device=device)
    world.add_camera(CameraConfig(distance=2.0), sensor=sensor, model=config)
    world.data.qvel[:] = 15.0
    seen = [packet.events.tobytes() for _ in range(ticks) for packet in world.step()]
    return seen, world


@pytest.mark.parametrize("chunk", [1, 8])
def test_packets_are_those_of_the_cpu(device: Any, chunk: int) -> None:
    """Also of a saved world that goes on elsewhere, and of one that starts again."""
    (expected, here), (found, there) = packets("cpu", chunk), packets("cuda", chunk)
    assert found == expected
    assert sum(map(len, found)) > 16 * 100
    saved = here.save(), there.save()
    here.restore(saved[1])
    there.restore(saved[0])
    for _ in range(2):
        for _ in range(40):
            one, other = ([p.events.tobytes() for p in world.step()] for world in (here, there))
            assert other == one
        here.reset(seed=5)
        there.reset(seed=5)


def test_nothing_is_left_behind(device: Any) -> None:
    weights, shape, options = drawn(0)
    gc.disable()
    try:
        _, gpu = pair(weights, shape, **options)
        _, state = gpu.step_chunk(film(1, 3, *shape), gpu.init(1), 0, 1000)
        left = [weakref.ref(thing) for thing in (gpu, gpu._there, state, state._there)]
        del gpu, state
        assert [thing() for thing in left] == [None] * len(left)
    finally:
        gc.enable()


@pytest.mark.parametrize("row", [-2, 0, 999])
def test_a_damaged_state_is_refused(device: Any, row: int) -> None:
    _, gpu = pair(random_network(1), (8, 8), sparse=False)
    saved = gpu.init(1).save()
    saved["tile_row"][0, 1] = row
    with pytest.raises(EvsError, match="tile_row is damaged; call init again"):
        gpu.restore(saved)


def test_a_state_of_the_cpu_has_to_be_restored(device: Any) -> None:
    cpu, gpu = pair(random_network(1), (8, 8))
    with pytest.raises(EvsError, match="not of model evsnet on a GPU; restore what its save gives"):
        gpu.step(np.zeros((8, 8), np.float32), cpu.init(1), 0, 1000)


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ({"runtime": "reference"}, "a GPU runs model.runtime native only, not reference; take cpu"),
        ({"runtime": "onnxruntime"}, "a GPU runs model.runtime native only, not onnxruntime"),
        ({"provider": "cuda"}, "provider 'cuda' is for runtime onnxruntime"),
        ({"labels": True}, "cannot label"),
        ({"device": "gpu"}, "model.device"),
    ],
)
def test_what_a_gpu_cannot_do_is_refused(device: Any, model: dict[str, Any], says: str) -> None:
    sensor = SensorParameters("test", 8, 8, 0.2, 0.2)
    config = ModelConfig(**{"name": "evsnet", "device": "cuda", **model})
    with pytest.raises(EvsError, match=says):
        make_event_model(sensor, config, 1)


def test_auto_takes_the_gpu_where_it_can(device: Any) -> None:
    sensor = SensorParameters("test", 8, 8, 0.2, 0.2)
    made = [
        make_event_model(sensor, ModelConfig(name="evsnet", device="auto", runtime=runtime), 1)
        for runtime in ("native", "reference")
    ]
    assert [isinstance(model, CudaEvsNetModel) for model in made] == [True, False]


def test_a_machine_without_a_gpu_says_so() -> None:
    if not driver.why_no_gpu():
        pytest.skip("there is one")
    sensor = SensorParameters("test", 8, 8, 0.2, 0.2)
    with pytest.raises(EvsError, match=r"model.device is cuda, but .*; take cpu, or auto"):
        make_event_model(sensor, ModelConfig(name="evsnet", device="cuda"), 1)
    auto = make_event_model(sensor, ModelConfig(name="evsnet", device="auto"), 1)
    assert not isinstance(auto, CudaEvsNetModel)
