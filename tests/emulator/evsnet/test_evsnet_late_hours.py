"""A network after hours, days and a century of ticks: nothing depends on how late it is."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.model import MAX_TIME_US, EvsNetModel
from evs.emulator.evsnet.runtime import RUNTIMES
from evs.emulator.evsnet.state import MAX_TICKS, NetworkState
from evs.emulator.sensor import SensorParameters
from reference.networks import random_network, through_network

pytestmark = pytest.mark.extremes

SENSOR = SensorParameters("test", 5, 3, 0.2, 0.2)
HOUR = 3_600_000
LATE = [2**24 + 1, 24 * HOUR, 2**31 + 7, 100 * 365 * 24 * HOUR]
"""ticks of 1 ms"""


def film(ticks: int, seed: int = 0) -> F32:
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(0, 0.2, (ticks, 3, 5)), axis=0)
    return np.exp(walk - 1).astype(np.float32)


@pytest.mark.parametrize("late", LATE)
@pytest.mark.parametrize("biased", [False, True])
@pytest.mark.parametrize("runtime", RUNTIMES)
def test_the_same_events_at_any_hour(late: int, biased: bool, runtime: str) -> None:
    model = EvsNetModel(SENSOR, random_network(1, biased=biased), runtime=runtime, threads=1)
    early, old = model.init(0), model.init(0)
    old.ticks += late
    old.last[:] += late
    shift_us = min(late * 1000, MAX_TIME_US - 10**6)
    first, early = model.step_chunk(film(80), early, 0, 1000)
    second, old = model.step_chunk(film(80), old, shift_us, 1000)
    assert sum(map(len, first)) > 300
    for ours, theirs in zip(first, second, strict=True):
        theirs["t"] -= shift_us
        assert ours.tobytes() == theirs.tobytes()
    assert old.v.tobytes() == early.v.tobytes()
    assert np.array_equal(old.last - late, early.last)


@pytest.mark.parametrize("wait", [1, 255, 256, 60_000, 2**20, 2**40])
def test_a_pixel_that_waited_long_answers_as_it_should(wait: int) -> None:
    """Its membrane has leaked meanwhile: from just below a threshold to nothing, in the end."""
    model = EvsNetModel(SENSOR, through_network(5.0, tau_s=10.0), runtime="reference")
    state = model.init(0)
    state.v[:] = 0.99
    _, state = model.step_chunk(np.ones((2, 3, 5), np.float32), state, 0, 1000)
    state.ticks += wait
    step = np.full((1, 3, 5), np.exp(0.1), np.float32)
    (events,), state = model.step_chunk(step, state, 2000, 1000)
    left = 0.99 * np.exp(-(wait + 2) / 10_000)
    expected = left + 0.5
    assert len(events) == (15 if expected >= 1 else 0)
    np.testing.assert_allclose(state.v, expected - (expected >= 1), atol=1e-5)


def test_the_last_tick_there_is() -> None:
    model = EvsNetModel(SENSOR, through_network(5.0), runtime="reference", initial="zero")
    state = model.init(0)
    _, state = model.step_chunk(np.ones((1, 3, 5), np.float32), state, 0, 1000)
    state.ticks = MAX_TICKS - 1
    bright = np.full((1, 3, 5), np.exp(0.3), np.float32)
    (events,), state = model.step_chunk(bright, state, MAX_TIME_US - 1000, 1000)
    assert set(events["t"].tolist()) == {MAX_TIME_US - 1000 + 667}
    assert NetworkState.restore(state.save()) == state
