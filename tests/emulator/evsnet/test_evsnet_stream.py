"""The streamed reference against the whole film at once, in float64; latency; homogeneity."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32, F64
from evs.emulator.evsnet import Convolution, NetworkWeights, reference
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.reference import ReferenceRuntime
from evs.emulator.sensor import SensorParameters
from reference.networks import random_network, through_network

SENSOR = SensorParameters("test", 5, 3, 0.2, 0.2)
NETWORKS = {
    "causal": random_network(1),
    "small": random_network(2, 4),
    "centred": random_network(3, look_ahead=3),
    "paper": random_network(4, biased=True, look_ahead=3),
    "biased": random_network(5, biased=True),
    "one ahead": random_network(6, 4, look_ahead=1),
    "no blocks": random_network(7, 3, blocks=0, biased=True),
    "one channel": random_network(8, 1, blocks=1),
}


def offline(weights: NetworkWeights, x: F64) -> F64:
    """Currents (ticks, pixels) of X (ticks, pixels), by valid convolutions of the padded film."""

    def valid(c: Convolution, line: F64) -> F64:
        ticks = line.shape[1] - 6
        windows = np.stack([line[:, j : j + ticks] for j in range(7)], axis=1)
        out: F64 = np.einsum("oij,ijtp->otp", c.weight.astype(np.float64), windows)
        return out if c.bias is None else out + c.bias[:, None, None]

    padded = np.concatenate([np.zeros((weights.receptive_field - 1, x.shape[1])), x])
    h = np.maximum(valid(weights.encoder, padded[np.newaxis]), 0)
    for block in weights.blocks:
        change = valid(block.second, np.maximum(valid(block.first, h), 0))
        # entry p of `change` has read h[p ... p + 12] and is of the tick look_ahead before the last
        middle = h[:, 12 - block.look_ahead : h.shape[1] - block.look_ahead]
        h = np.maximum(middle + change, 0)
    out: F64 = np.einsum("c,ctp->tp", weights.last.astype(np.float64), h)
    return out + weights.last_bias


def light(ticks: int, seed: int = 0) -> F32:
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(0, 0.1, (ticks, 3, 5)) * (rng.random((ticks, 3, 5)) < 0.5), axis=0)
    return np.exp(walk - 1).astype(np.float32)


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("chunk", [1, 7, 90])
def test_streamed_is_offline(name: str, chunk: int) -> None:
    weights, film = NETWORKS[name], light(90)
    runtime = ReferenceRuntime(SENSOR, weights)
    state = EvsNetModel(SENSOR, weights, runtime="reference").init(0)
    currents = np.empty_like(film)
    for first in range(0, 90, chunk):
        part = slice(first, first + chunk)
        runtime.step(film[part], state, first * 1000, currents[part])
    exact = offline(weights, steps_of(film, weights)).reshape(film.shape)
    assert np.abs(exact).max() > 0.1
    np.testing.assert_allclose(currents, exact, rtol=0, atol=1e-5)


def steps_of(film: F32, weights: NetworkWeights) -> F64:
    """X in float64: ln is smooth at the knee e, and this film is far above it."""
    assert weights.linlog_dn < 255 * float(film.min())
    log = np.log(255.0 * film.astype(np.float64)).reshape(len(film), -1)
    return np.diff(log, axis=0, prepend=log[:1])


@pytest.mark.parametrize("look_ahead", [0, 1, 2, 3])
@pytest.mark.parametrize("blocks", [0, 1, 3])
def test_latency_is_as_declared(look_ahead: int, blocks: int) -> None:
    weights = through_network(2.0, blocks, look_ahead=look_ahead)
    model = EvsNetModel(SENSOR, weights, runtime="reference")
    late = look_ahead * (1 + 2 * blocks)
    assert model.latency_us == 1000 * late
    runtime, state, film = ReferenceRuntime(SENSOR, weights), model.init(0), light(60)
    currents = np.empty_like(film)
    runtime.step(film, state, 0, currents)
    x = steps_of(film, weights).reshape(film.shape)
    np.testing.assert_allclose(currents[late:], 2.0 * x[: 60 - late], atol=1e-5)
    assert not np.any(currents[:late])


def test_events_come_and_are_stamped_late_by_the_latency() -> None:
    film = np.ones((60, 3, 5), np.float32)
    film[20:] = np.exp(0.3)
    for look_ahead, late in ((0, 0), (3, 21)):
        weights = through_network(5.0, look_ahead=look_ahead)
        model = EvsNetModel(SENSOR, weights, runtime="reference", initial="zero")
        events, _ = model.step_chunk(film, model.init(0), 500_000, 1000)
        assert [k for k, tick in enumerate(events) if len(tick)] == [20 + late]
        # two thirds of the tick, rounded up
        assert set(events[20 + late]["t"].tolist()) == {500_000 + (20 + late) * 1000 + 667}


@pytest.mark.parametrize("name", ["causal", "small", "centred", "one channel"])
def test_positive_homogeneity(name: str) -> None:
    """Without biases, X of twice the size is a current of exactly twice the size."""
    runtime = ReferenceRuntime(SENSOR, NETWORKS[name])
    x = np.random.default_rng(9).normal(0, 0.2, (50, 15)).astype(np.float32)

    def currents(scale: float) -> F32:
        fifos = [np.array(a, np.float32) for a in runtime.own_arrays().values()]
        return runtime.convolve(x * np.float32(scale), fifos)[0]

    one = currents(1.0)
    for power in (-8, 1, 6):
        assert currents(2.0**power).tobytes() == (one * np.float32(2.0**power)).tobytes()
    np.testing.assert_allclose(currents(3.0), 3.0 * one, atol=1e-5)
    assert not np.any(currents(0.0))


@pytest.mark.parametrize("name", NETWORKS)
def test_at_rest_the_current_is_what_the_rest_says(name: str) -> None:
    weights = NETWORKS[name]
    runtime = ReferenceRuntime(SENSOR, weights)
    fifos = list(runtime.own_arrays().values())
    current, after = runtime.convolve(np.zeros((20, 15), np.float32), fifos)
    if weights.is_still:
        assert not np.any(current)
    # the same in every tick, from the first on
    assert np.ptp(current) == 0
    for before, now in zip(fifos, after, strict=True):
        np.testing.assert_allclose(now, before, atol=1e-6)


def test_a_state_of_the_runtime_is_what_the_network_reads() -> None:
    weights = NETWORKS["paper"]
    state = EvsNetModel(SENSOR, weights, runtime="reference").init(0)
    for i, rest in enumerate(weights.rest()):
        fifo = state.arrays[f"fifo{i}"]
        assert fifo.shape == (len(rest), 6, 15)
        assert np.array_equal(fifo, np.broadcast_to(rest[:, None, None], fifo.shape))


def test_blocks_of_any_size_are_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(block: int) -> tuple[F32, bytes]:
        monkeypatch.setattr(reference, "BLOCK", block)
        film, currents = light(40), np.empty((40, 3, 5), np.float32)
        state = EvsNetModel(SENSOR, NETWORKS["paper"], runtime="reference").init(0)
        ReferenceRuntime(SENSOR, NETWORKS["paper"]).step(film, state, 0, currents)
        return currents, b"".join(array.tobytes() for array in state.arrays.values())

    whole, state = run(4096)
    for block in (1, 4, 15):
        currents, after = run(block)
        assert currents.tobytes() == whole.tobytes()
        assert after == state
