"""The native network: what it computes, and that nothing it may choose shows in its bytes."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32, F64
from evs.emulator.evsnet import Convolution, NetworkWeights
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.native import LANES, NativeRuntime
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.agreement import Run, run
from reference.networks import random_network, through_network

HEIGHT, WIDTH = 10, 23
"""no multiple of 4 either way; 3 x 6 tiles"""
SENSOR = SensorParameters("test", WIDTH, HEIGHT, 0.2, 0.25, dark_lux=0.1)
NETWORKS = {
    "8": random_network(1),
    "4": random_network(2, 4),
    "1": random_network(3, 1),
    "3, 1 block": random_network(4, 3, 1),
    "16, 1 block": random_network(5, 16, 1),
    "no blocks": random_network(6, 9, 0),
    "centred": random_network(7, look_ahead=3),
    "one ahead": random_network(8, 5, 2, look_ahead=1),
    "biased": random_network(9, biased=True),
    "paper": random_network(10, biased=True, look_ahead=3),
    "biased, no blocks": random_network(11, 2, 0, biased=True),
}


def light(ticks: int, height: int = HEIGHT, width: int = WIDTH, seed: int = 0) -> F32:
    """A third of the image moves, here and there and now and then; some of it is no light."""
    rng = np.random.default_rng(seed)
    frame = np.exp(rng.normal(-2, 1, (height, width)))
    film = np.empty((ticks, height, width), np.float32)
    for k in range(ticks):
        moves = (rng.random((height, width)) < 0.2) & (np.arange(width) < 1 + width // 3)
        moves &= (k // 50) % 3 == 0
        frame = np.where(moves, frame * np.exp(rng.normal(0, 0.3, frame.shape)), frame)
        film[k] = frame
        film[k][moves & (rng.random(frame.shape) < 0.01)] = rng.choice([np.nan, -1, np.inf, 0])
    return film


def model(weights: NetworkWeights, **options: object) -> EvsNetModel:
    return EvsNetModel(SENSOR, weights, runtime="native", **options)  # type: ignore[arg-type]


def stream(found: Run) -> tuple[object, ...]:
    """What must be the same whatever the native runtime chooses, its own memory aside."""
    state = found.state
    return (
        found.currents.tobytes(),
        [tick.tobytes() for tick in found.events],
        *(state.arrays[name].tobytes() for name in ("v", "last", "last_luminance", "last_log")),
        (state.ticks, state.clamped, state.x_clamped, state.v_clamped),
    )


def causal(c: Convolution, h: F64) -> F64:
    """As a stream has it: (in, ticks, pixels) to (out, ticks, pixels), zeros before the first."""
    padded = np.pad(h, ((0, 0), (6, 0), (0, 0)))
    ticks = h.shape[1]
    taps = [np.tensordot(c.weight[:, :, j], padded[:, j : j + ticks], 1) for j in range(7)]
    total: F64 = np.sum(taps, axis=0, dtype=np.float64)
    return total if c.bias is None else total + c.bias[:, None, None]


def plainly(weights: NetworkWeights, x: F64) -> F64:
    """Currents (ticks, pixels) of X in float64: light stood still for 60 ticks before."""
    x = np.pad(x, ((60, 0), (0, 0)))
    h = np.maximum(causal(weights.encoder, x[np.newaxis]), 0)
    for block in weights.blocks:
        change = causal(block.second, np.maximum(causal(block.first, h), 0))
        late = np.roll(h, block.look_ahead, axis=1)
        h = np.maximum(late + change, 0)
    out: F64 = np.tensordot(weights.last.astype(np.float64), h, 1)[60:] + weights.last_bias
    return out


@pytest.mark.parametrize("name", NETWORKS)
def test_currents_are_those_of_the_plain_network(name: str) -> None:
    weights = NETWORKS[name]
    film = np.nan_to_num(light(90), nan=0.1, posinf=0.1)
    film = np.maximum(film, np.float32(0.01))
    dn = film.astype(np.float64) * SENSOR.exposure_dn + SENSOR.dark_dn
    log = np.where(dn >= np.e, np.log(np.maximum(dn, 1e-9)), dn / np.e).reshape(90, -1)
    expected = plainly(weights, np.diff(log, axis=0, prepend=log[:1])).reshape(film.shape)
    for cut in (1, 16, 32):
        found = run(model(weights), film, cut=cut)
        assert np.max(np.abs(expected)) > 0.3
        # X comes from float32 logarithms: up to 1e-6 of each, times what the filters make of it
        assert np.max(np.abs(found.currents - expected)) < 1e-5 * max(1, np.max(np.abs(expected)))


@pytest.mark.parametrize(
    ("name", "events_per_tick"),
    [*((name, "one") for name in NETWORKS), *((name, "many") for name in ("8", "4", "paper"))],
)
def test_sparse_is_dense_on_every_instruction_set_thread_and_cut(
    name: str, events_per_tick: str
) -> None:
    weights, film, rule = NETWORKS[name], light(72), {"events_per_tick": events_per_tick}
    whole = stream(run(model(weights, sparse=False, threads=1, **rule), film, cut=32))
    assert sum(len(tick) for tick in whole[1]) > 16 * 100  # type: ignore[attr-defined]
    for isa, sparse, (cut, threads) in product(
        _core.isa_available(), (True, False), ((32, 2), (7, 3))
    ):
        other = model(weights, isa=isa, sparse=sparse, threads=threads, **rule)
        assert stream(run(other, film, cut=cut)) == whole, (isa, sparse, cut)


@pytest.mark.parametrize(
    ("name", "events_per_tick"),
    [("8", "one"), ("8", "many"), ("centred", "one"), ("3, 1 block", "one"), ("biased", "many")],
)
def test_any_cut_and_thread_leaves_the_same_state(name: str, events_per_tick: str) -> None:
    """Also who has which row of the memory, and how many there are."""
    weights, film, rule = NETWORKS[name], light(170), {"events_per_tick": events_per_tick}
    whole = run(model(weights, **rule), film, cut=1)
    assert whole.state.clamped > 0
    for cut, threads in ((8, 1), (16, 2), (31, 3), (32, 1), (170, 2)):
        found = run(model(weights, threads=threads, **rule), film, cut=cut)
        assert stream(found) == stream(whole), cut
        assert found.state == whole.state, cut


@pytest.mark.parametrize(
    ("height", "width"), [(1, 1), (3, 2), (4, 4), (5, 16), (2, 33), (17, 3), (8, 64)]
)
def test_an_image_of_any_size_is_part_of_a_larger_one(height: int, width: int) -> None:
    film = light(50, 20, 68)
    sensor = SensorParameters("large", 68, 20, 0.2, 0.25)
    for name in ("8", "paper"):
        large = run(EvsNetModel(sensor, NETWORKS[name]), film)
        sensor_part = SensorParameters("part", width, height, 0.2, 0.25)
        part = run(EvsNetModel(sensor_part, NETWORKS[name]), film[:, :height, :width])
        assert part.currents.tobytes() == large.currents[:, :height, :width].tobytes()
        assert part.state.v.tobytes() == large.state.v[:height, :width].tobytes()
        for few, all_of_them in zip(part.events, large.events, strict=True):
            inside = (all_of_them["x"] < width) & (all_of_them["y"] < height)
            assert few.tolist() == all_of_them[inside].tolist()


def test_events_are_sorted_by_time_then_row_by_row() -> None:
    found = run(model(NETWORKS["4"]), light(60))
    assert max(map(len, found.events)) > 20
    for k, tick in enumerate(found.events):
        keys = list(zip(tick["t"].tolist(), tick["y"].tolist(), tick["x"].tolist(), strict=True))
        assert keys == sorted(keys)
        assert np.all((tick["t"] > 1000 * k) & (tick["t"] <= 1000 * (k + 1)))
        assert not np.any(tick.view(np.uint8).reshape(-1, 16)[:, 13:])


def test_the_events_of_a_trail_are_a_tick_apart() -> None:
    """A step of 12 thresholds: one at the crossing, then those left, as V forgets ever later."""
    film = np.full((40, HEIGHT, WIDTH), 0.01, np.float32)
    film[10:, 9, 22] = np.exp(2.41) * 0.01
    bright = SensorParameters("test", WIDTH, HEIGHT, 0.2, 0.2, exposure_dn=1e4)
    for sparse in (True, False):
        one = EvsNetModel(bright, through_network(5.0, tau_s=15.0), initial="zero", sparse=sparse)
        events, state = one.step_chunk(film, one.init(0), 0, 1000)
        assert [len(tick) for tick in events] == [0] * 10 + [1] * 12 + [0] * 18
        stamps = [int(tick["t"][0]) for tick in events[10:22]]
        assert stamps[:2] == [10_083, 11_951]
        assert set(np.diff(stamps[1:]).tolist()) == {1000, 1001}
        assert state.v[9, 22] < 0.1


def test_memory_is_of_moving_tiles_alone_and_given_back() -> None:
    film = np.full((300, HEIGHT, WIDTH), 0.5, np.float32)
    film[20:40, 5, 6] *= np.linspace(1.0, 2.0, 20, dtype=np.float32)
    film[40:, 5, 6] = film[39, 5, 6]
    one = model(NETWORKS["8"])
    state = one.init(0)
    assert state.arrays["fifo"].shape == (0, (1 + 6 * 8) * 6 * LANES)
    held = []
    for k in range(0, 300, 10):
        _, state = one.step_chunk(film[k : k + 10], state, 1000 * k, 1000)
        rows = state.arrays["tile_row"]
        assert np.all(rows[rows != 0] == -1)
        held.append(bool(rows[1, 1] == 0))
    # X is not 0 in ticks 21 ... 39; after 42 more nothing is left, after 32 more the row is free
    assert held == [2 <= k < 11 for k in range(30)]
    assert not np.any(state.arrays["fifo"])


def test_a_dense_state_may_go_on_sparse_and_back() -> None:
    film = light(60)
    sparse, dense = model(NETWORKS["8"]), model(NETWORKS["8"], sparse=False)
    whole = run(sparse, film)
    for first, second in ((sparse, dense), (dense, sparse)):
        head, state = first.step_chunk(film[:30], first.init(1), 0, 1000)
        tail, state = second.step_chunk(film[30:], state, 30_000, 1000)
        assert b"".join(e.tobytes() for e in head + tail) == b"".join(
            e.tobytes() for e in whole.events
        )
        assert state.v.tobytes() == whole.state.v.tobytes()


def test_the_callers_thread_keeps_its_denormals() -> None:
    small = np.array([1e-40], np.float32)
    run(model(NETWORKS["8"]), light(5))
    assert (small * np.float32(0.5))[0] > 0


def test_an_unknown_instruction_set_is_refused() -> None:
    with pytest.raises(EvsError, match="cannot run instruction set 'sse'; use auto"):
        NativeRuntime(SENSOR, NETWORKS["8"], isa="sse")
