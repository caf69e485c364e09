"""Light that stands still, and light that is none: no ghosts, no dead and no screaming pixels."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.evsnet import NetworkWeights
from evs.emulator.evsnet.model import MAX_CHUNK, EvsNetModel
from evs.emulator.evsnet.runtime import RUNTIMES
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from reference.networks import STILL, STRANGE, shipped, through_network

pytestmark = pytest.mark.extremes

SENSOR = SensorParameters("test", 4, 2, 0.2, 0.2)


@pytest.fixture(params=RUNTIMES)
def runtime(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def run(weights: NetworkWeights, runtime: str, film: F32) -> tuple[list[int], NetworkState]:
    """How many events each tick has."""
    model = EvsNetModel(SENSOR, weights, runtime=runtime, threads=1)
    events, state = model.step_chunk(film, model.init(1), 0, 1000)
    return [len(tick) for tick in events], state


def at_rest(state: NetworkState) -> bool:
    """Whether all that the network has in mind is 0."""
    fifos = [array for name, array in state.arrays.items() if name.startswith("fifo")]
    assert fifos
    return not any(map(np.any, fifos))


def held(light: float, ticks: int) -> F32:
    return np.full((ticks, 2, 4), light, np.float32)


def same_but_ticks(a: NetworkState, b: NetworkState) -> bool:
    b = b.copy()
    b.ticks = a.ticks
    return a == b


@pytest.mark.parametrize("light", [0.0, 1e-30, 1e-3, 0.5, 1.0, 1e9])
def test_still_light_is_silent_for_ever(light: float, runtime: str) -> None:
    """A tick of it changes no bit of the state, so neither does any number of them."""
    for weights in (*STILL.values(), *shipped().values()):
        model = EvsNetModel(SENSOR, weights, runtime=runtime, threads=1)
        state = model.init(2)
        for k in range(2):
            events, state = model.step(held(light, 1)[0], state, k * 1000, (k + 1) * 1000)
            assert len(events) == 0
        kept = state.copy()
        events, state = model.step(held(light, 1)[0], state, 2000, 3000)
        assert len(events) == 0
        assert same_but_ticks(kept, state)


@pytest.mark.slow
def test_still_light_is_silent_for_100_000_ticks() -> None:
    # a current that never ends brings a membrane to its last value in 10,000 ticks, twenty of its
    # time constants; a counter that runs over would need more
    cases = [(STILL["C = 4"], "reference", 10_000)]
    cases += [(weights, "native", 100_000) for weights in (*STILL.values(), *shipped().values())]
    few = SensorParameters("few", 3, 1, 0.2, 0.2)
    light = np.array([0.0, 0.3, 1e4], np.float32).reshape(1, 1, 3)
    film = np.broadcast_to(light, (MAX_CHUNK, 1, 3))
    for weights, runtime, ticks in cases:
        model = EvsNetModel(few, weights, runtime=runtime, threads=1)
        state = model.init(2)
        for first in range(0, ticks, MAX_CHUNK):
            chunks, state = model.step_chunk(film, state, first * 1000, 1000)
            assert not any(map(len, chunks))


@pytest.mark.parametrize("name", STILL)
def test_after_a_change_it_falls_silent_again(name: str, runtime: str) -> None:
    """Once W ticks of still light and the trail are over, nothing is left but the membrane."""
    film = np.concatenate([held(0.1, 5), held(30.0, 200), held(0.2, 200)])
    counts, state = run(STILL[name], runtime, film)
    assert sum(counts) > 0
    assert not any(counts[150:205] + counts[-50:])
    assert at_rest(state)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf"), -1.0, 3e38])
@pytest.mark.parametrize("name", STILL)
def test_light_that_is_none_is_as_if_it_had_stood_still(
    name: str, bad: float, runtime: str
) -> None:
    rng = np.random.default_rng(4)
    film = np.exp(np.cumsum(rng.normal(0, 0.2, (120, 2, 4)), axis=0) - 1).astype(np.float32)
    lost = film.copy()
    still = film.copy()
    for first, last, y, x in ((20, 45, 0, 1), (60, 61, 1, 3), (30, 90, 1, 0), (118, 120, 0, 0)):
        lost[first:last, y, x] = bad
        still[first:last, y, x] = still[first - 1, y, x]
    model = EvsNetModel(SENSOR, STILL[name], runtime=runtime, threads=1)
    found, state = model.step_chunk(lost, model.init(1), 0, 1000)
    expected, other = model.step_chunk(still, model.init(1), 0, 1000)
    assert [tick.tobytes() for tick in found] == [tick.tobytes() for tick in expected]
    assert state.clamped == 25 + 1 + 60 + 2
    assert other.clamped == 0
    other.clamped = state.clamped
    assert state == other


@pytest.mark.parametrize("bad", STRANGE)
@pytest.mark.parametrize("ticks", [1, 10])
def test_whatever_passes_the_pixel_works_afterwards(bad: float, ticks: int, runtime: str) -> None:
    """Strange light in one column: after it, and its trail, each pixel answers as its neighbour."""
    film = np.concatenate([held(0.5, 20), held(0.5, ticks), held(0.5, 150), held(0.75, 60)])
    film[20 : 20 + ticks, :, 1] = bad
    weights = through_network(5.0, tau_s=0.5)
    model = EvsNetModel(SENSOR, weights, runtime=runtime, threads=1, initial="zero")
    events, state = model.step_chunk(film, model.init(0), 0, 1000)
    for name, array in state.arrays.items():
        assert np.all(np.isfinite(array)), name
    columns = [[int(np.sum(tick["x"] == x)) for tick in events] for x in (1, 2)]
    step = 20 + ticks + 150
    # silent long before the step, whatever came; then a step of two thresholds
    assert not any(columns[0][step - 50 : step])
    assert sum(columns[1][step:]) == 2 * 2
    assert sum(columns[0][step:]) in (2, 4, 6)  # one more or less each: what is left of V


@pytest.mark.parametrize("name", STILL)
@pytest.mark.parametrize("bad", STRANGE)
def test_no_strange_light_kills_a_network(name: str, bad: float, runtime: str) -> None:
    film = np.concatenate([held(0.5, 5), held(bad, 3), held(0.5, 3), held(bad, 1), held(0.5, 200)])
    counts, state = run(STILL[name], runtime, film)
    assert not any(counts[-50:])
    assert np.all(np.abs(state.v) <= 64)
    assert at_rest(state)


def test_no_light_at_all(runtime: str) -> None:
    """A pixel that has never seen light is silent; its first light sets the reference."""
    counts, state = run(
        STILL["C = 8"], runtime, np.concatenate([held(float("nan"), 40), held(5.0, 40)])
    )
    assert not any(counts)
    assert state.clamped == 40 * 8
