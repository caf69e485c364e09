"""Photon noise: its events against simulated noise, ticks of any length, and published shapes.

Where a test says within so many percent, this is the error of the model; 3.3 standard errors of
what was measured come on top of it.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from reference.two_pole_noise import (
    NoiseStatistics,
    native_events,
    noisy_sensor,
    random_phase,
    simulated_events,
)

pytestmark = pytest.mark.statistical

THETA = 0.2
POLES_HZ = [(30.0, 3000.0), (300.0, 3000.0), (300.0, 900.0)]
NOISES = [0.3, 0.5]
"""standard deviation of the noise, thresholds"""


def even(side: int, luminance: float = 1.0) -> F32:
    return np.full((side, side), luminance, np.float32)


def end_us(poles_hz: tuple[float, float]) -> int:
    return 200_000 if min(poles_hz) < 100 else 60_000


@functools.cache
def native(
    poles_hz: tuple[float, float], noise: float, tick_us: int, side: int, seed: int
) -> NoiseStatistics:
    sensor = noisy_sensor(poles_hz, noise * THETA, THETA, side)
    end = end_us(poles_hz)
    phase = random_phase(THETA, side, 1)
    events = native_events(sensor, even(side), phase, end, tick_us, seed)
    return NoiseStatistics.of(events, side, end)


@pytest.mark.slow
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("poles_hz", POLES_HZ)
def test_events_are_those_of_simulated_noise(poles_hz: tuple[float, float], noise: float) -> None:
    """Rate within 10 %, flips within 0.03, shares of intervals as follows.

    Intervals up to the median of the simulated ones are half of the native ones within 0.05, up to
    their 90 % quantile 90 % within 0.02. Short intervals are too frequent: up to the simulated 10 %
    quantile it is 10 % within 0.1.
    """
    side = 40
    phase = random_phase(THETA, side, 1)
    end = end_us(poles_hz)
    simulated = NoiseStatistics.of(
        simulated_events(poles_hz, noise * THETA, THETA, phase, end, 2), side, end
    )
    ours = native(poles_hz, noise, 100, side, 3)
    assert len(simulated.intervals_us) > 1500
    assert ours.rate_hz.agrees(simulated.rate_hz, 0.1 * simulated.rate_hz.value)
    assert ours.flips.agrees(simulated.flips, 0.03)
    for share, model_error in ((0.1, 0.1), (0.5, 0.05), (0.9, 0.02)):
        interval_us = simulated.quantile_us(share)
        below = simulated.share_below(interval_us)
        assert below.value == pytest.approx(share, abs=0.002)
        assert ours.share_below(interval_us).agrees(below, model_error), share


@pytest.mark.parametrize("tick_us", [20, 1_000, 10_000])
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("poles_hz", POLES_HZ)
def test_ticks_of_any_length_have_the_same_noise(
    poles_hz: tuple[float, float], noise: float, tick_us: int
) -> None:
    """Against ticks of 100 us: rate within 4 %, flips within 0.03, intervals as shares of 0.04."""
    side = 40
    fine, coarse = native(poles_hz, noise, 100, side, 3), native(poles_hz, noise, tick_us, side, 4)
    assert coarse.rate_hz.agrees(fine.rate_hz, 0.04 * fine.rate_hz.value)
    assert coarse.flips.agrees(fine.flips, 0.03)
    for share in (0.1, 0.5, 0.9):
        interval_us = fine.quantile_us(share)
        assert coarse.share_below(interval_us).agrees(fine.share_below(interval_us), 0.04), share


@pytest.mark.parametrize("poles_hz", POLES_HZ)
def test_successive_events_of_noise_flip_their_polarity(poles_hz: tuple[float, float]) -> None:
    """After an event the reference lies off the signal, on the side from which the noise returns.

    Independent events would flip half of the time. The noise returns to its mean, which is nearer
    to the other threshold, unless it is so large that it reaches the next one, too. The shares are
    those of simulated noise, above.
    """
    for noise, least in ((0.3, 0.985), (0.5, 0.8)):
        flips = native(poles_hz, noise, 1000, 40, 4).flips
        assert flips.value - 3.3 * flips.error > least
    small, large = (native(poles_hz, noise, 1000, 40, 4).flips for noise in NOISES)
    assert small.value > large.value
