"""Bandwidth: the frequency at which a full sine gives as many events as 0.707 of it, when slow.

Light is E (1 + m sin 2 pi f t) with a small m. How many events a period brings depends on how far
the signal still swings, and on nothing else; so a slow sine of m / sqrt(2) shows how many there are
at -3 dB. The biases are set for it: low thresholds, no refractory period. Leak and noise, which
low thresholds would raise over the signal, and the high pass are left out: the filter is measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs_lab.characterise.bench import F64, Bench, pixel_numbers
from evs_lab.characterise.expected import half_power_hz
from evs_lab.characterise.fit import crossing, mean_and_error
from evs_lab.characterise.quantity import Quantity

LADDER_LUX = (1.0, 10.0, 100.0, 1_000.0, 10_000.0)
PIXELS = 40_000
DEPTHS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""m; the first that gives enough events is used. The bandwidth of a pixel swings with its light,
less with a small m: the first depth leaves an error of about m^2"""

ENOUGH = 4.0
"""events of one polarity in a slow period"""

COUNTING = 0.002
"""error from counting whole events, as a share of the frequency"""

BIASES = {
    "pos_thres": 0.0125,
    "neg_thres": 0.0125,
    "sigma_thres": 0.00125,
    "refractory_period_s": 0.0,
    "highpass_hz": 0.0,
    "leak_rate_hz": 0.0,
    "parasitic_leak_hz": 0.0,
    "shot_noise_rate_hz": 0.0,
    "photocurrent_pa": 0.0,
    "hot_leak_median_hz": 0.0,
    "dead_pixel_fraction": 0.0,
}
TICKS = 64
"""of a period that is longer than that many microseconds"""

LEAST_TICKS = 16
FASTEST_HZ = 1e6 / LEAST_TICKS
SLOW = 64.0
"""a sine is slow if it is so many times slower than the bandwidth"""

PERIODS = 2
"""that are counted; one period before them lets the pixels settle"""

SEARCH = 40
"""steps after which the search ends without a result; most change the frequency by 10 or 3"""

AROUND = (0.8, 0.95, 1.1, 1.3)
"""where the curve is measured, relative to the frequency found"""


@dataclass(frozen=True)
class Bandwidth:
    """The bandwidth at one illuminance."""

    lux: float
    half_power_hz: float
    """inf: faster than the bench; NaN: no events even when slow"""
    error_hz: float
    frequency: F64
    """(n,) Hz, ascending"""
    gain: F64
    """(n,) of the swing, 1 where slow"""


def measure_bandwidth(bench: Bench, lux: float) -> Bandwidth:
    """Find the frequency at half power, then measure the curve around it.

    Args:
        bench: the bench with the sensor.
        lux: mean illuminance.
    """
    lamp = _Lamp(bench.part(PIXELS, **BIASES), lux, DEPTHS[0])
    # a data sheet says where to look; the search goes on from there as far as it must
    guess = min(half_power_hz(bench.sensor, lux), 0.5 * FASTEST_HZ)
    for depth in DEPTHS:
        lamp = replace(lamp, depth=depth)
        if lamp.events_a_period(guess / SLOW)[0] >= ENOUGH:
            break
    else:
        return Bandwidth(lux, math.nan, math.nan, np.zeros(0), np.zeros(0))
    deep = _find(lamp, guess)
    if lamp.depth == DEPTHS[0] or not math.isfinite(deep.half_power_hz):
        return deep
    # what a deep swing changes grows with its square: half of it at 0.707 of the depth
    less = _find(replace(lamp, depth=lamp.depth * math.sqrt(0.5)), deep.half_power_hz)
    error_hz = math.hypot(2.0 * less.error_hz, deep.error_hz)
    return replace(less, half_power_hz=2.0 * less.half_power_hz - deep.half_power_hz,
                   error_hz=error_hz)  # fmt: skip


def _find(lamp: _Lamp, guess: float) -> Bandwidth:
    """Find the bandwidth at one depth of modulation.

    Args:
        lamp: the lamp with that depth.
        guess: where the search begins, Hz.
    """
    fastest = 0.5 * FASTEST_HZ
    nothing = np.zeros(0)
    for _ in range(SEARCH):
        slow, _ = lamp.events_a_period(guess / SLOW)
        half, half_error = lamp.events_a_period(guess / SLOW, math.sqrt(0.5))
        gain = _gain(lamp.events_a_period(guess)[0], slow, half)
        if 0.6 < gain < 0.8:
            break
        if gain > 0.75 and guess == fastest:
            return Bandwidth(lamp.lux, math.inf, math.nan, nothing, nothing)
        # as a filter of one pole would have it; from far away it is a step in the right direction
        gain = min(max(gain, 0.1), 0.95)
        guess = min(guess / math.sqrt(1.0 / gain**2 - 1.0), fastest)
    else:
        return Bandwidth(lamp.lux, math.nan, math.nan, nothing, nothing)
    frequency = guess * np.array(AROUND)
    counted = [lamp.events_a_period(f) for f in frequency]
    count, error = (np.array(values) for values in zip(*counted, strict=True))
    # a cubic through the four, over the logarithm of frequency
    fine = np.linspace(math.log(AROUND[0]), math.log(AROUND[-1]), 257)
    cubic = np.polynomial.Polynomial.fit(np.log(AROUND), count, len(AROUND) - 1)
    found = guess * math.exp(crossing(fine, cubic(fine), half))
    slope = abs(float(cubic.deriv()(math.log(found / guess))))
    chance = math.hypot(half_error, float(error.mean())) / slope
    error_hz = found * math.hypot(chance, COUNTING, DEPTHS[0] ** 2)
    gains = [1.0, *(_gain(c, slow, half) for c in count)]
    return Bandwidth(
        lamp.lux, found, error_hz, np.array([guess / SLOW, *frequency]), np.array(gains)
    )


def _gain(count: float, slow: float, half: float) -> float:
    """Events of a period grow in proportion to the swing, but for what hysteresis takes."""
    root = math.sqrt(0.5)
    return max(root + (1.0 - root) * (count - half) / (slow - half), 0.0)


@dataclass(frozen=True)
class _Lamp:
    """A sensor in light that swings."""

    bench: Bench
    lux: float
    depth: float

    def events_a_period(self, hz: float, share: float = 1.0) -> tuple[float, float]:
        """Events of a pixel and period, half of both polarities', with the error over pixels.

        Args:
            hz: of the lamp.
            share: of the depth of modulation.
        """
        bench = self.bench
        period_us = 1e6 / hz
        ticks = max(LEAST_TICKS, min(TICKS, math.floor(period_us)))
        exposure = bench.start(self.lux)
        total = np.zeros(bench.pixels)
        last_us = 0
        for k in range(1, (1 + PERIODS) * ticks + 1):
            at_us = max(round(k / ticks * period_us), last_us + 1)
            light = 1.0 + self.depth * share * math.sin(2.0 * math.pi * at_us / period_us)
            events = exposure.expose(self.lux * light, at_us - last_us)
            last_us = at_us
            if k > ticks:
                total += np.bincount(pixel_numbers(events, bench.sensor), minlength=bench.pixels)
        return mean_and_error(total / (2.0 * PERIODS))


def bandwidth_results(sensor: SensorParameters, found: Sequence[Bandwidth]) -> list[Quantity]:
    """One line an illuminance."""
    results = []
    for at in found:
        promised = half_power_hz(sensor, at.lux)
        measured, note = at.half_power_hz, ""
        if math.isinf(measured):
            measured, note = math.nan, f"over {0.5 * FASTEST_HZ / 1e3:.0f} kHz"
        elif math.isnan(measured):
            note = "too few events"
        promised = math.nan if math.isinf(promised) else promised
        results.append(
            Quantity("bandwidth, -3 dB", "Hz", measured, at.error_hz, promised, at.lux, note)
        )
    return results
