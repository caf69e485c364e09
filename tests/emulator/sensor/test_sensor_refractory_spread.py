"""Refractory periods that differ from pixel to pixel: their distribution, and what pixels do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from evs.emulator import _core
from evs.emulator.sensor import PlainModel, SensorParameters
from reference.pixel.model import ReferenceModel, caught_up

SENSOR = SensorParameters(
    "spread", 100, 80, 0.2, 0.2, refractory_period_s=0.001, refractory_spread_decades=0.15
)


@pytest.mark.statistical
def test_periods_are_log_normal_and_their_mean_is_what_was_set() -> None:
    periods = PlainModel(SENSOR).pattern(1).refractory_us
    assert periods is not None
    sigma = 0.15 * math.log(10.0)
    relative = math.sqrt(math.expm1(sigma**2))
    count = periods.size
    assert abs(periods.mean() / 1000.0 - 1.0) < 4.5 * relative / math.sqrt(count)
    logs = np.log10(periods)
    assert abs(logs.std() / 0.15 - 1.0) < 4.5 / math.sqrt(2 * count)
    # normal logarithms; whole us are far below the spread
    shape = scipy.stats.kstest(((logs - logs.mean()) / logs.std()).ravel(), "norm")
    assert shape.pvalue > 1e-3
    # another seed is another sensor, and no other term moves
    other = PlainModel(SENSOR).pattern(2).refractory_us
    assert other is not None
    assert np.corrcoef(periods.ravel(), other.ravel())[0, 1] < 4.5 / math.sqrt(count)
    noisy = replace(SENSOR, sigma_thres=0.03, leak_rate_hz=1.0)
    with_spread, without = (
        PlainModel(replace(noisy, refractory_spread_decades=decades)).pattern(1)
        for decades in (0.15, 0.0)
    )
    assert without.refractory_us is None
    assert np.array_equal(with_spread.on, without.on)
    assert np.array_equal(with_spread.leak, without.leak)


def test_a_pixel_is_blind_for_its_own_period() -> None:
    """Light that rises by many thresholds a ms: the next event comes a threshold after it sees."""
    model = PlainModel(SENSOR, 1)
    periods = model.pattern(7).refractory_us
    assert periods is not None
    state, times = model.init(7), [[] for _ in range(periods.size)]
    for k in range(40):
        light = np.full((80, 100), 0.01 * math.exp(0.5 * k), np.float32)
        events, state = model.step(light, state, (k - 1) * 500, k * 500)
        for t, x, y, _ in events.tolist():
            times[y * 100 + x].append(t)
    # log light rises by a unit a ms, a threshold in 200 us; stamps and crossings are whole us
    for pixel, period in zip(times, periods.ravel().tolist(), strict=True):
        intervals = np.diff([t for t in pixel if t > 5000])
        assert len(intervals) > 1
        assert (np.abs(intervals - (period + 200)) <= 2).all()


@pytest.mark.parametrize("tick_us", [100, 1700])
def test_native_is_the_oracle(tick_us: int) -> None:
    sensor = replace(
        SENSOR, width=10, height=8, refractory_period_s=0.0003, refractory_spread_decades=0.4,
        sigma_thres=0.03, cutoff_hz=900.0, leak_rate_hz=100.0, shot_noise_rate_hz=200.0,
    )  # fmt: skip
    generator = np.random.default_rng(2)
    oracle = ReferenceModel(sensor)
    models = [PlainModel(sensor, 2, isa) for isa in _core.isa_available()]
    expected, *states = (model.init(5) for model in (oracle, *models))
    count = 0
    for k in range(15):
        frame = generator.uniform(0.1, 1.0, (8, 10)).astype(np.float32)
        span = (k * tick_us, (k + 1) * tick_us)
        events, expected = oracle.step(frame, expected, *span)
        count += len(events)
        for i, model in enumerate(models):
            ours, states[i] = model.step(frame, states[i], *span)
            assert ours.tobytes() == events.tobytes()
            assert caught_up(sensor, states[i]) == expected
    assert count > 50


def test_no_period_is_under_a_microsecond_and_none_without_a_mean() -> None:
    tiny = replace(SENSOR, refractory_period_s=1e-6, refractory_spread_decades=1.0)
    periods = PlainModel(tiny).pattern(1).refractory_us
    assert periods is not None
    assert periods.min() == 1
    huge = replace(SENSOR, refractory_period_s=100.0, refractory_spread_decades=1.0)
    periods = PlainModel(huge).pattern(1).refractory_us
    assert periods is not None
    assert periods.max() == 2**30
    none = replace(SENSOR, refractory_period_s=0.0)
    assert PlainModel(none).pattern(1).refractory_us is None
