"""Photon noise: native gives the oracle's bytes and state, whatever it is combined with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters
from evs.emulator.sensor.running_mean import RunningMeanConstants
from evs.msgs import EvsError
from reference.pixel.model import ReferenceModel, caught_up

WIDTH, HEIGHT = 12, 6
SENSOR = SensorParameters(
    "test", WIDTH, HEIGHT, 0.2, 0.2, 0.03, log="ln", cutoff_hz=300.0, follower_hz=900.0,
    dark_lux=1.0, dim_lux=1.0, photocurrent_pa=0.3, leak_rate_hz=2.0, refractory_period_s=2e-4,
)  # fmt: skip
TERMS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "strong": {"photocurrent_pa": 0.05},
    "out of reach of most levels": {"photocurrent_pa": 100.0},
    "photoreceptor alone": {"follower_hz": 0.0},
    "follower alone": {"cutoff_hz": 0.0, "follower_hz": 300.0, "photocurrent_pa": 30.0},
    "large signal": {"filter": "large_signal"},
    "no leak": {"leak_rate_hz": 0.0},
    "no refractory period": {"refractory_period_s": 0.0},
    "long refractory period": {"refractory_period_s": 5e-3},
    "shot noise": {"shot_noise_rate_hz": 100.0},
    "high pass": {"highpass_hz": 1.0},
    "defects": {"parasitic_leak_hz": 5.0, "hot_leak_median_hz": 1.0, "dead_pixel_fraction": 0.1},
}


def films(ticks: int) -> Iterator[tuple[str, list[F32]]]:
    """Still, moving, moving until it stops, and wild."""
    x, y = np.arange(WIDTH), np.arange(HEIGHT)[:, None]
    random = np.random.default_rng(0)

    def wave(k: int) -> F32:
        return (0.3 + 0.28 * np.sin(0.5 * x + 0.3 * y + 0.05 * k)).astype(np.float32)

    yield "still", [wave(0)] * ticks
    yield "moving", [wave(k) for k in range(ticks)]
    yield "stops", [wave(min(k, 10)) for k in range(ticks)]
    light = np.array([0.0, 1e-3, 0.5, 1.0, 50.0, np.nan], np.float32)
    yield "wild", [random.choice(light, size=(HEIGHT, WIDTH)) for _ in range(ticks // 4)]


@pytest.mark.parametrize(
    "tick_us", [50, *(pytest.param(k, marks=pytest.mark.slow) for k in (1000, 20_000))]
)
@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_native_is_the_oracle(terms: dict[str, Any], tick_us: int) -> None:
    sensor, events = replace(SENSOR, **terms), 0
    for film, frames in films(8 if tick_us == 20_000 else 32):
        events += same_as_oracle(sensor, frames, tick_us, film)
    assert events > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["as it is", "high pass"])
def test_native_is_the_oracle_in_long_ticks(name: str) -> None:
    sensor = replace(SENSOR, **{"photocurrent_pa": 3.0, "leak_rate_hz": 20.0, **TERMS[name]})
    moving = dict(films(2))["moving"]
    assert same_as_oracle(sensor, moving, 100_000, "moving") > 100


@pytest.mark.slow
def test_native_is_the_oracle_behind_a_running_mean() -> None:
    for film, frames in films(40):
        same_as_oracle(SENSOR, frames, 1000, film, RunningMeanConstants())


def same_as_oracle(
    sensor: SensorParameters,
    frames: list[F32],
    tick_us: int,
    film: str,
    average: RunningMeanConstants | None = None,
) -> int:
    """Step both through a film; the number of events."""
    oracle = ReferenceModel(sensor, average=average, causes=True)
    models = [
        PlainModel(sensor, 2, isa, average=average, causes=True) for isa in _core.isa_available()
    ]
    expected = oracle.init(5)
    states: list[PlainState] = [model.init(5) for model in models]
    events = 0
    for k, frame in enumerate(frames):
        span = (k * tick_us, (k + 1) * tick_us)
        packet, expected = oracle.step(frame, expected, *span)
        events += len(packet)
        for i, model in enumerate(models):
            ours, states[i] = model.step(frame, states[i], *span)
            assert ours.tobytes() == packet.tobytes(), (film, k)
            if k % 8 == 7:
                assert caught_up(sensor, states[i]) == expected, (film, k)
    return events


def test_a_budget_never_runs_out_without_an_event() -> None:
    """Where the hazard is so near to the budget that rounding would leave nothing of it."""
    frames = [frame for _, film in films(20) for frame in film[:20]][20:40]  # moving
    models = [ReferenceModel(SENSOR), PlainModel(SENSOR, 1)]
    state = models[1].init(5)
    for k, frame in enumerate(frames[:-2]):
        _, state = models[1].step(frame, state, k * 1000, (k + 1) * 1000)
    ample = state.copy()
    ample.noise_budget[:] = 20.0
    _, after = models[1].step(frames[-2], ample.copy(), state.clock_us, state.clock_us + 1000)
    used = 20.0 - after.noise_budget
    exact = (used > 0.0) & (used < 1.0)
    least = 2.0**-46
    spent = 0
    for model in models:
        tight = state.copy()
        tight.noise_budget[exact] = used[exact]
        _, now = model.step(frames[-2], tight, state.clock_us, state.clock_us + 1000)
        spent = int(np.count_nonzero(now.noise_budget == least))
        assert now.noise_budget.min() > 0.0
        model.step(frames[-1], now, now.clock_us, now.clock_us + 1000)
    assert spent > 0


def test_a_saved_budget_that_cannot_be_is_refused() -> None:
    model = PlainModel(SENSOR, 1)
    _, state = model.step(np.full((HEIGHT, WIDTH), 0.3, np.float32), model.init(1), 0, 1000)
    saved = state.save()
    for bad in (0.0, -1.0, np.nan, 5e-324):
        budget = saved["noise_budget"].copy()
        budget[2, 3] = bad
        with pytest.raises(EvsError, match="damaged"):
            PlainState.restore({**saved, "noise_budget": budget})


def test_a_still_block_sleeps_until_its_noise_is_due() -> None:
    sensor = replace(SENSOR, photocurrent_pa=3.0, leak_rate_hz=0.0)
    model = PlainModel(sensor, 1)
    frame = np.full((HEIGHT, WIDTH), 0.3, np.float32)
    state = model.init(1)
    for k in range(200):
        _, state = model.step(frame, state, k * 1000, (k + 1) * 1000)
    assert state.due_us is not None
    assert state.due_us.min() > state.clock_us + 100_000


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        ({"dark_lux": 0.0, "log": "linlog"}, "photocurrent_pa needs a dark current"),
        ({"cutoff_hz": 0.0, "follower_hz": 0.0}, "photocurrent_pa needs a bandwidth"),
    ],
)
def test_noise_without_a_bound_is_refused(terms: dict[str, Any], words: str) -> None:
    with pytest.raises(EvsError, match=words):
        replace(SENSOR, **terms)
