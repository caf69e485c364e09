"""Noise, leak, filters and blindness do not depend on how time is cut into ticks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from evs import SensorConfig
from evs.emulator.base.scene import F32
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.presets import resolve_sensor
from evs.msgs import Events
from reference.waves import MIDDLE, Waves, run

pytestmark = pytest.mark.statistical

SIDE, SECOND = 48, 1_000_000
IDEAL = SensorParameters("ideal", SIDE, SIDE, 0.2, 0.2, exposure_dn=1.0)
NOISY = replace(
    IDEAL, sigma_thres=0.03, leak_rate_hz=2.0, parasitic_leak_hz=1.0, shot_noise_rate_hz=20.0,
    noise_rate_cov_decades=0.2, refractory_period_s=0.002, hot_leak_median_hz=0.1,
)  # fmt: skip


def still(t_us: float) -> F32:
    """From dark to bright, a brightness to each column; it never changes."""
    return np.tile(np.geomspace(0.5, 255, SIDE).astype(np.float32), (SIDE, 1))


@pytest.mark.parametrize("tick_us", [100, 500, 8_000, SECOND])
def test_still_light_has_the_same_noise_in_ticks_of_any_length(tick_us: int) -> None:
    """Leak, shot noise, hot pixels, blindness: event by event, not only in the mean."""
    ours, theirs = run(NOISY, still, tick_us, SECOND), run(NOISY, still, 1000, SECOND)
    assert len(theirs) > 20_000
    assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("tick_us", [1000, 500, 100])
def test_shot_noise_has_its_rate_in_ticks_of_any_length(tick_us: int) -> None:
    """Poisson counts of other seeds, 48 brightnesses, against v2e's law; significance 1e-3."""
    rate_hz, bright = 30.0, 0.25
    sensor = replace(IDEAL, shot_noise_rate_hz=rate_hz, shot_noise_bright=bright)
    events = run(sensor, still, tick_us, SECOND, seed=tick_us)
    share = 1 - (1 - bright) * np.minimum(1, (still(0)[0] + 20) / 275)
    expected = rate_hz * share * SIDE  # of a column in a second
    found = np.bincount(events["x"], minlength=SIDE)
    chi_square = ((found - expected) ** 2 / expected).sum()
    assert scipy.stats.chi2.ppf(0.0005, SIDE) < chi_square < scipy.stats.chi2.ppf(0.9995, SIDE)
    # half of them ON; and at any time of the tick
    on = np.count_nonzero(events["p"])
    assert abs(on - len(events) / 2) < 3.3 * math.sqrt(len(events) / 4)
    place = np.bincount((events["t"] - 1) % tick_us * 20 // tick_us, minlength=20)
    assert scipy.stats.chisquare(place).pvalue > 1e-3


@pytest.mark.parametrize("tick_us", [1000, 500])
def test_moving_light_and_noise_have_the_same_rates(tick_us: int) -> None:
    """All terms on; counts of each polarity and 20 ms, significance 1e-3."""
    sensor = replace(NOISY, cutoff_hz=300.0, follower_hz=1000.0, highpass_hz=0.1)
    light = Waves.of(SIDE, 8.0, 4).luminance

    def counts(events: Events) -> np.ndarray:
        bins = (events["t"] - 1) // 20_000
        return np.bincount(events["p"] * 50 + bins, minlength=100)

    a, b = counts(run(sensor, light, tick_us, SECOND)), counts(run(sensor, light, 100, SECOND))
    assert b.sum() > 50_000
    chi_square = ((a - b) ** 2 / (a + b)).sum()
    assert chi_square < scipy.stats.chi2.ppf(0.999, 100)


def triangle(t_us: float) -> F32:
    """Light that rises by e^3 in 2 s and falls again."""
    light = 0.05 * math.exp(3.0 - 3.0 * abs(t_us / SECOND / 2.0 - 1.0))
    return np.full((16, 16), light, np.float32)


@pytest.mark.parametrize("hz", [30.0, 0.0], ids=["leak", "signal"])
@pytest.mark.parametrize("preset", ["davis346", "dvs128", "dvxplorer", "genx320", "imx636"])
def test_photon_noise_loses_no_event_in_long_ticks(preset: str, hz: float) -> None:
    """Counts of ON and OFF by leak in still light, and by light that rises and falls, per second.

    Without the high pass of genx320, which is no line in a tick longer than its time constant.
    """
    sensor = resolve_sensor(SensorConfig(preset, width=16, height=16))
    sensor = replace(sensor, leak_rate_hz=hz, highpass_hz=0.0)
    light, end_us = ((lambda t_us: triangle(SECOND)), 2 * SECOND) if hz else (triangle, 4 * SECOND)
    counts = []
    for tick_us in (1000, 10_000, 100_000, 250_000, 500_000, SECOND, 2 * SECOND):
        events = run(sensor, light, tick_us, end_us)
        counts.append(np.bincount(events["p"], minlength=2) / (256 * end_us / SECOND))
    np.testing.assert_allclose(counts, np.broadcast_to(counts[0], (7, 2)), rtol=0.03, atol=0.15)


RISE = np.linspace(0.55, 1.95, SIDE * SIDE).reshape(SIDE, SIDE)


def rising(t_us: float) -> F32:
    """Half a period of 2 Hz, trough to peak, of another height in each pixel."""
    return np.exp(MIDDLE - RISE * math.cos(2 * math.pi * 2.0 * t_us * 1e-6)).astype(np.float32)


@pytest.mark.parametrize("poles", ["first", "both"])
def test_crossing_times_of_filtered_light_converge_at_second_order(poles: str) -> None:
    """dim_lux this large is a bandwidth that is the same in any light, so that y' = w (x - y) is
    linear: its answer to MIDDLE - R cos is known."""
    cutoff_hz, follower_hz = 8.0, 20.0 if poles == "both" else 0.0
    sensor = replace(
        IDEAL, cutoff_hz=cutoff_hz, follower_hz=follower_hz, dim_lux=1e6, bright_lux=1e-3
    )
    found = [run(sensor, rising, tick_us, 250_000) for tick_us in (25_000, 12_500, 6_250, 3_125)]
    fine = run(sensor, rising, 125, 250_000)

    def nth(events: Events) -> dict[tuple[int, int], int]:
        """(pixel, how manieth of its ON events) -> stamp."""
        on = events[events["p"] == 1]
        seen, stamps = np.zeros(SIDE * SIDE, int), {}
        for t, x, y in on[["t", "x", "y"]].tolist():
            pixel = y * SIDE + x
            stamps[pixel, int(seen[pixel])] = t
            seen[pixel] += 1
        return stamps

    exact = nth(fine)
    deviation = []
    for events in found:
        stamps = nth(events)
        # late in the curve it is flat, and early it answers to the start: the steep part
        errors = [
            stamps[key] - t for key, t in exact.items() if key in stamps and 60_000 < t < 200_000
        ]
        assert len(errors) > 5000
        deviation.append(math.sqrt(np.mean(np.square(errors))))
    order = np.log2(np.array(deviation[:-1]) / deviation[1:])
    assert np.all(np.abs(order - 2) < 0.25), (order, deviation)
