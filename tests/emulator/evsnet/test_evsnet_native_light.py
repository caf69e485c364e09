"""The native network in light that stands still, and in light that is none."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.sensor import SensorParameters
from reference.networks import STILL, STRANGE, shipped, through_network

pytestmark = pytest.mark.extremes

SENSOR = SensorParameters("test", 13, 6, 0.2, 0.2)


def held(light: float, ticks: int) -> F32:
    return np.full((ticks, 6, 13), light, np.float32)


@pytest.mark.parametrize("sparse", [True, False])
@pytest.mark.parametrize("light", [0.0, 1e-30, 1e-3, 0.5, 1.0, 1e9])
def test_still_light_is_silent_and_changes_nothing(light: float, sparse: bool) -> None:
    for weights in (STILL | shipped()).values():
        model = EvsNetModel(SENSOR, weights, sparse=sparse)
        events, state = model.step_chunk(held(light, 50), model.init(2), 0, 1000)
        before = state.copy()
        more, state = model.step_chunk(held(light, 5000), state, 50_000, 1000)
        assert not any(map(len, events + more))
        before.ticks = state.ticks
        assert state == before


@pytest.mark.slow
def test_still_light_is_silent_for_a_million_ticks() -> None:
    model = EvsNetModel(SENSOR, STILL["C = 8"])
    light = np.geomspace(1e-6, 1e6, 6 * 13).reshape(1, 6, 13).astype(np.float32)
    film = np.broadcast_to(light, (1000, 6, 13))
    state = model.init(2)
    for k in range(1000):
        events, state = model.step_chunk(film, state, k * 1_000_000, 1000)
        assert not any(map(len, events))


@pytest.mark.parametrize("name", STILL)
@pytest.mark.parametrize("bad", STRANGE)
def test_after_strange_light_a_network_falls_silent(name: str, bad: float) -> None:
    film = np.concatenate([held(0.5, 5), held(bad, 3), held(0.5, 3), held(bad, 1), held(0.5, 250)])
    film[:, :, 5:] = 0.3
    model = EvsNetModel(SENSOR, STILL[name])
    events, state = model.step_chunk(film, model.init(1), 0, 1000)
    assert not any(len(tick) for tick in events[-50:])
    assert not any(np.any(tick["x"] >= 5) for tick in events)
    assert np.all(np.abs(state.v) <= 64)
    # no FIFO holds anything, and no tile has one
    assert not np.any(state.arrays["fifo"])
    assert np.all(state.arrays["tile_row"] == -1)


@pytest.mark.parametrize("bad", STRANGE)
@pytest.mark.parametrize("ticks", [1, 10, 100])
def test_whatever_passes_a_pixel_works_afterwards(bad: float, ticks: int) -> None:
    film = np.concatenate([held(0.5, 20), held(0.5, ticks), held(0.5, 250), held(0.75, 60)])
    film[20 : 20 + ticks, :, 4] = bad
    model = EvsNetModel(SENSOR, through_network(5.0), initial="zero")
    events, state = model.step_chunk(film, model.init(0), 0, 1000)
    step = 20 + ticks + 250
    strange, normal = ([int(np.sum(tick["x"] == x)) for tick in events] for x in (4, 5))
    assert not any(strange[step - 50 : step])
    assert sum(normal[step:]) == 2 * 6
    assert sum(strange[step:]) in (6, 12, 18)  # one more or less each: what is left of V
    assert all(np.all(np.isfinite(array)) for array in state.arrays.values())


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -1.0, 3e38])
def test_light_that_is_none_is_as_if_it_had_stood_still(bad: float) -> None:
    rng = np.random.default_rng(4)
    film = np.exp(np.cumsum(rng.normal(0, 0.2, (120, 6, 13)), axis=0) - 1).astype(np.float32)
    lost, still = film.copy(), film.copy()
    for first, last, y, x in ((20, 45, 0, 1), (60, 61, 5, 12), (30, 90, 3, 3), (118, 120, 4, 0)):
        lost[first:last, y, x] = bad
        still[first:last, y, x] = still[first - 1, y, x]
    for cut in (1, 32):
        model = EvsNetModel(SENSOR, STILL["C = 8"])
        state, other = model.init(1), model.init(1)
        for k in range(0, 120, cut):
            found, state = model.step_chunk(lost[k : k + cut], state, 1000 * k, 1000)
            expected, other = model.step_chunk(still[k : k + cut], other, 1000 * k, 1000)
            assert [t.tobytes() for t in found] == [t.tobytes() for t in expected]
        assert (state.clamped, other.clamped) == (25 + 1 + 60 + 2, 0)
        other.clamped = state.clamped
        assert state == other


def test_no_light_at_all_then_light() -> None:
    film = np.concatenate([held(float("nan"), 40), held(5.0, 40)])
    model = EvsNetModel(SENSOR, STILL["C = 8"])
    events, state = model.step_chunk(film, model.init(0), 0, 1000)
    assert not any(map(len, events))
    assert state.clamped == 40 * 6 * 13
