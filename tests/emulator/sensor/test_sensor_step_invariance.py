"""How time is cut into ticks: the same rates, and crossing times that converge."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import scipy

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import SensorParameters
from evs.msgs import Events
from reference.waves import MIDDLE, Waves, run

pytestmark = pytest.mark.statistical

SIDE, SECOND = 32, 1_000_000
THETA = 0.2
FASTEST_HZ = 8.0
TICKS_US = (1000, 500, 100)
SENSOR = SensorParameters("waves", SIDE, SIDE, THETA, THETA, exposure_dn=1.0)


@cache
def events_of(tick_us: int) -> Events:
    return run(SENSOR, Waves.of(SIDE, FASTEST_HZ, 1).luminance, tick_us, SECOND)


def counts(events: Events, bin_us: int) -> np.ndarray:
    """Events of each polarity and bin of time."""
    bins = (events["t"] - 1) // bin_us
    return np.bincount(events["p"] * (SECOND // bin_us) + bins, minlength=2 * SECOND // bin_us)


def by_pixel(events: Events) -> np.ndarray:
    return np.bincount(events["y"].astype(int) * SIDE + events["x"], minlength=SIDE * SIDE)


@pytest.mark.parametrize("tick_us", TICKS_US[:-1])
def test_rates_do_not_depend_on_the_tick(tick_us: int) -> None:
    coarse, fine = events_of(tick_us), events_of(TICKS_US[-1])
    assert len(fine) > 20_000
    # homogeneity of two rows of counts, significance 1e-3
    a, b = counts(coarse, 20_000), counts(fine, 20_000)
    chi_square = ((a - b) ** 2 / np.maximum(a + b, 1)).sum()
    assert chi_square < scipy.stats.chi2.ppf(0.999, np.count_nonzero(a + b))


@pytest.mark.parametrize("tick_us", TICKS_US[:-1])
def test_only_what_peaks_between_two_ticks_is_lost(tick_us: int) -> None:
    """The same light gives the same events, so pixels differ far less than chance would allow."""
    coarse, fine = by_pixel(events_of(tick_us)), by_pixel(events_of(TICKS_US[-1]))
    assert np.all(np.abs(coarse - fine) <= 4)
    # at a peak the ticks miss up to max |L''| dt^2 / 8; with it a level, by chance, and two events
    bend = (2 * math.pi * FASTEST_HZ) ** 2 * 2.0
    missed = bend * (tick_us * 1e-6) ** 2 / 8
    expected = 2 * FASTEST_HZ * SIDE * SIDE * missed / THETA
    assert np.count_nonzero(coarse != fine) < expected + 5 * math.sqrt(expected)


def rising(t_us: float) -> F32:
    """Half a period of 2 Hz, trough to peak, at other amplitudes in each pixel."""
    return np.exp(MIDDLE - AMPLITUDES * math.cos(2 * math.pi * 2.0 * t_us * 1e-6)).astype(
        np.float32
    )


AMPLITUDES: F64 = np.linspace(0.55, 1.95, SIDE * SIDE).reshape(SIDE, SIDE)


def rounding_up(tick_us: int) -> F64:
    """Error of each stamp against the closed form, us; both are rounded up to whole us."""
    events = run(SENSOR, rising, tick_us, 250_000 // tick_us * tick_us)
    amplitude = AMPLITUDES[events["y"], events["x"]]
    # the k-th event of a pixel lies k thresholds over its trough
    pixel = events["y"].astype(np.int64) * SIDE + events["x"]
    order = np.argsort(pixel, kind="stable")
    first = np.searchsorted(pixel[order], pixel[order])
    nth = np.empty(len(events), np.int64)
    nth[order] = np.arange(len(events)) - first + 1
    assert np.all(events["p"] == 1)
    # ends of the curve are left out: it is flat there, and a stamp has no meaning
    risen = nth * THETA / amplitude
    steep = (risen > 0.2) & (risen < 1.8)
    exact = np.arccos(1 - risen[steep]) / (2 * math.pi * 2.0) * 1e6
    return np.asarray(events["t"][steep] - np.ceil(exact))


def test_crossing_times_converge_at_second_order() -> None:
    """A line through two ticks is off by L'' dt^2 / 8 at most: a quarter for half the tick."""
    root_mean_square = []
    for tick_us in (25_000, 12_500, 6_250, 3_125):
        errors = rounding_up(tick_us)
        assert len(errors) > 5000
        root_mean_square.append(math.sqrt(np.mean(errors**2)))
    order = np.log2(np.array(root_mean_square[:-1]) / root_mean_square[1:])
    assert np.all(np.abs(order - 2) < 0.15), order
    # at 1 kHz and faster the stamps are right to the us they are rounded to, and dt^2 / 8 L'' / L'
    for tick_us in (1000, 500, 100):
        errors = rounding_up(tick_us)
        # between risen .2 and 1.8 the bend is at most 4 / 3 of the slope, times 2 pi rate
        worst = (tick_us * 1e-6) ** 2 / 8 * (4 / 3) * (2 * math.pi * 2.0) * 1e6
        assert np.abs(errors).max() <= 1 + worst
