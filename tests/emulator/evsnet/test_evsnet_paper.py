"""Where the paper can be read in two ways: the reading of DESIGN section 5, and that it matters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import decay_per_tick
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from evs.msgs import Events
from reference.networks import through_network

ONE = SensorParameters("one", 1, 1, 0.2, 0.2)


def light_of(steps: list[float]) -> F32:
    """(ticks, 1, 1): light whose log, far over the knee, moves by these; the first is the start."""
    log = np.cumsum(np.array([0.0, *steps]))
    return np.exp(log).astype(np.float32).reshape(-1, 1, 1)


def run(
    steps: list[float], tau_s: float = 10.0, gain: float = 5.0, v0: float = 0.0
) -> tuple[list[Events], NetworkState]:
    """Current = X / threshold: the ideal pixel in units of its thresholds."""
    model = EvsNetModel(
        ONE, through_network(gain, tau_s=tau_s), runtime="reference", initial="zero"
    )
    state = model.init(0)
    state.v[:] = v0
    return model.step_chunk(light_of(steps), state, 0, 1000)


def polarities(events: list[Events]) -> list[int]:
    return [0 if len(tick) == 0 else 1 if tick["p"][0] else -1 for tick in events]


def test_the_threshold_is_on_the_charged_membrane_and_the_event_in_the_same_tick() -> None:
    """S(k) is of V'(k), not of V(k - 1): an event comes in the tick that brings it."""
    events, _ = run([0.0, 0.21, 0.0, -0.22])
    assert polarities(events) == [0, 0, 1, 0, -1]


def test_the_reset_subtracts_and_does_not_forget() -> None:
    """V = V' - S: contrast over the threshold stays, twice 1.55 thresholds are three events."""
    events, state = run([0.31, 0.0, 0.31, 0.0, 0.0])
    assert polarities(events) == [0, 1, 0, 1, 1, 0]
    assert float(state.v[0, 0]) == pytest.approx(0.1, abs=0.01)


def test_one_event_a_pixel_and_tick_then_a_trail() -> None:
    """The paper's saturation effect: a step of ten thresholds fires in ten ticks, the last ten."""
    events, _ = run([10.5 * 0.2, *[0.0] * 15], tau_s=15.0)
    assert [len(tick) for tick in events] == [0, *[1] * 10, *[0] * 6]


def test_a_step_of_ln_20_thresholds_is_as_long_a_trail() -> None:
    """FACTS: from black to a sun is X = 20, 57 ... 61 events at a leak of half a second."""
    events, state = run([20.0, *[0.0] * 120], tau_s=0.5, gain=5.0)
    # 100 thresholds are over the clamp of 64; the leak takes some of them
    trail = sum(len(tick) for tick in events)
    assert 57 <= trail <= 61
    assert state.v_clamped == 1


def test_the_leak_is_an_exponential_in_seconds() -> None:
    """d = e^(-dt / tau), not 1 - 1 / tau of ticks: one decay for every tick length."""
    _, state = run([0.1, *[0.0] * 399, 0.0125])
    start = 5.0 * 0.1
    expected = start * math.exp(-0.4 / 10.0) + 5.0 * 0.0125
    assert float(state.v[0, 0]) == pytest.approx(expected, rel=1e-5)
    # ten ticks of 1 ms leave what one of 10 ms does
    assert decay_per_tick(0.5, 1000) ** 10 == pytest.approx(decay_per_tick(0.5, 10_000), rel=1e-14)


def test_internal_state_bias() -> None:
    """Pixels that see the same fire at different times, as their V(0) are different."""
    sensor = SensorParameters("row", 64, 1, 0.2, 0.2)
    model = EvsNetModel(sensor, through_network(5.0, tau_s=15.0), runtime="reference")
    slope = np.exp(0.01 * np.arange(41)).astype(np.float32)
    film = np.repeat(slope[:, np.newaxis, np.newaxis], 64, axis=2)
    state = model.init(3)
    v0 = state.v.copy()
    events, _ = model.step_chunk(film, state, 0, 1000)
    first = np.full(64, -1)
    for tick, found in enumerate(events):
        fresh = found["x"][first[found["x"]] < 0]
        first[fresh] = tick
    # a pixel at V(0) needs (1 - V(0)) / .05 ticks, less the little that leaks
    wanted = (1 - v0[0]) / 0.05
    assert np.all(first >= 1)
    assert np.all((first >= np.floor(wanted)) & (first <= np.ceil(wanted) + 2))
    assert len(set(first.tolist())) > 20


def test_constant_light_is_silent_whatever_the_state() -> None:
    for v0 in (-0.999, 0.999):
        events, state = run([0.0] * 200, v0=v0)
        assert polarities(events) == [0] * 201
        assert float(state.v[0, 0]) == np.float32(v0)


def test_both_signs_are_alike() -> None:
    """+V_th and -V_th: light upside down gives the same events of the other polarity."""
    rng = np.random.default_rng(5)
    steps = rng.normal(0.0, 0.15, 300).tolist()
    # far over the knee, where ln turns e^s into s for both signs
    up, _ = run(steps)
    down, _ = run([-step for step in steps])
    assert polarities(down) == [-event for event in polarities(up)]
    assert sum(map(abs, polarities(up))) > 40
