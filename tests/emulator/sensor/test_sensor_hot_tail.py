"""Warm and hot pixels: a log-normal tail of leak, fitted to real pixels; what counts as hot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.fixed_pattern import draw_pattern
from evs.emulator.sensor.parameters import HOT_LEAK_HZ, MOST_HOT_LEAK_HZ

IEBCS = SensorParameters("tail", 640, 480, 0.2, 0.2, hot_leak_median_hz=0.0045)
"""with the default spread"""


def rates_hz(sensor: SensorParameters, seed: int = 1) -> np.ndarray:
    pattern = draw_pattern(sensor, seed)
    assert pattern.leak is not None
    return np.asarray(pattern.leak.astype(np.float64) / pattern.on * 1e6)


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("over_hz", "share", "pixels"), [(1.0, 0.022, 55), (5.0, 0.0036, 9), (20.0, 0.0008, 2)]
)
def test_the_tail_is_that_of_real_pixels(over_hz: float, share: float, pixels: int) -> None:
    """IEBCS's real still pixels, of 2500: the fit lies within what so few pixels tell."""
    leaks = rates_hz(IEBCS)
    found = np.count_nonzero(leaks > over_hz) / leaks.size
    # 13 % off at most by the fit itself, and five standard errors of 307,200 drawn pixels
    error = 5 * np.sqrt(share / leaks.size)
    assert abs(found - share) < 0.13 * share + error
    assert abs(found - share) < share / np.sqrt(pixels)


@pytest.mark.statistical
def test_no_pixel_floods() -> None:
    leaks = rates_hz(replace(IEBCS, hot_leak_median_hz=10.0, leak_rate_hz=0.1))
    assert leaks.max() == pytest.approx(MOST_HOT_LEAK_HZ + 0.1, rel=1e-3)
    assert 0.01 < np.mean(leaks > 0.999 * MOST_HOT_LEAK_HZ) < 0.1


def test_a_pixel_is_hot_by_its_own_tail_alone() -> None:
    """A leak that all pixels have makes none of them hot; the temperature of the chip may."""
    leaky = replace(IEBCS, leak_rate_hz=5.0)
    cool, warm = draw_pattern(leaky, 1), draw_pattern(replace(leaky, temperature_c=60.0), 1)
    assert cool.hot is not None
    assert warm.hot is not None
    assert np.array_equal(cool.hot == 1, rates_hz(IEBCS) > HOT_LEAK_HZ)
    assert 3 * np.count_nonzero(cool.hot) < np.count_nonzero(warm.hot)
    assert np.all(warm.hot >= cool.hot)


@pytest.mark.statistical
def test_hot_events_come_at_the_rates_that_were_drawn() -> None:
    sensor = replace(IEBCS, width=160, height=120, leak_rate_hz=0.05)
    model = PlainModel(sensor, 1, causes=True)
    light = np.full((120, 160), 0.5, np.float32)
    seconds, counts, hot = 20, np.zeros(160 * 120), 0
    _, state = model.step(light, model.init(1), -1000, 0)
    for k in range(seconds):
        events, state = model.step(light, state, k * 1_000_000, (k + 1) * 1_000_000)
        counts += np.bincount(events["y"].astype(int) * 160 + events["x"], minlength=160 * 120)
        hot += int(np.count_nonzero(events.view(np.uint8).reshape(-1, 16)[:, 13] == 4))
    leaks = rates_hz(sensor).reshape(-1)
    # leak is regular: every pixel has its count within one
    assert np.abs(counts - leaks * seconds).max() <= 1.01
    is_hot = model.pattern(1).hot
    assert is_hot is not None
    assert hot == counts[is_hot.reshape(-1) == 1].sum() > 1000
