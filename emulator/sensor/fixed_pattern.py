"""The fixed pattern: what every pixel has of its own, and keeps.

A term that is off has no array here and draws no number; every term has numbers of its own, so
that switching one on moves no other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.base.arrays import on_lines
from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor.parameters import HOT_LEAK_HZ, MOST_HOT_LEAK_HZ, SensorParameters
from evs.emulator.sensor.random import Term, exp10, pixel_normals, pixel_uniforms
from evs.emulator.sensor.terms import terms_of

FLOOR = 0.01
"""No threshold that is drawn is lower (v2e's floor), but where the mean itself is."""

GRID = 2.0**43
"""References and the leak of a microsecond are multiples of 1 / GRID: core/sensor/comparator.h."""

Mask = np.ndarray[Any, np.dtype[np.uint8]]


Periods = np.ndarray[Any, np.dtype[np.uint32]]

LONGEST_US = 2**30
"""No refractory period that is drawn is longer, 18 minutes."""


@dataclass(frozen=True)
class FixedPattern:
    """Of (h, w) pixels. It follows from sensor and seed, so it is no state."""

    on: F32
    """(h, w) ON threshold, log units; infinite: the pixel is dead"""
    off: F32
    """(h, w) OFF threshold, log units"""
    leak: F32 | None = None
    """(h, w) log units by which the reference sinks in a us, a multiple of 2^-43"""
    parasitic: F32 | None = None
    """(h, w) by how much more at bright_lux, log units per us"""
    phase: F32 | None = None
    """(h, w) log units by which the first reference lies below the light: as if it had leaked
    for long"""
    hot: Mask | None = None
    """(h, w) 1: the pixel is hot, its part of the tail of leak is over HOT_LEAK_HZ"""
    shot_on: F32 | None = None
    """(h, w) rate of ON noise in the dark, Hz"""
    shot_off: F32 | None = None
    """(h, w) rate of OFF noise in the dark, Hz"""
    refractory_us: Periods | None = None
    """(h, w) refractory period, whole us, 1 or more"""


def floor(mean: float) -> float:
    """The lowest threshold that pixels of this mean may have, log units."""
    return min(FLOOR, mean)


def draw_pattern(
    sensor: SensorParameters, seed: int, terms: frozenset[str] | None = None
) -> FixedPattern:
    """Draw the fixed pattern: one standard normal number N per pixel and term.

    theta = max(floor(mean), mean + sigma N); rates and refractory periods times 10^(cov N), so
    that the mean of that is 1.

    Args:
        sensor: The sensor, resolved.
        seed: What it follows from.
        terms: Those the pixels have; None: those the sensor needs.
    """
    size = (sensor.width, sensor.height)
    terms = terms_of(sensor) if terms is None else terms

    def threshold(mean: float, term: Term) -> F64:
        if "threshold_spread" not in terms:
            return np.full(size[::-1], mean)
        normals = pixel_normals(seed, term, *size)
        return np.maximum(floor(mean), mean + sensor.sigma_thres * normals)

    def spread(term: Term) -> F64 | float:
        cov = sensor.noise_rate_cov_decades
        return _log_normal(cov, seed, term, size) if "rate_spread" in terms else 1.0

    on = threshold(sensor.pos_thres, Term.THRESHOLD_ON)
    off = threshold(sensor.neg_thres, Term.THRESHOLD_OFF)
    values: dict[str, Any] = {}
    dead = np.zeros((sensor.height, sensor.width), bool)
    tail_hz: F64 | float = 0.0
    if "defects" in terms:
        dead = pixel_uniforms(seed, Term.DEFECT, *size) < sensor.dead_pixel_fraction
    if "hot_pixels" in terms:
        decades = sensor.hot_leak_cov_decades * pixel_normals(seed, Term.HOT_LEAK, *size)
        warm = sensor.hot_leak_median_hz * sensor.thermal_factor * exp10(decades)
        tail_hz = np.minimum(warm, MOST_HOT_LEAK_HZ)
    if "shot_noise" in terms:
        # half of it is ON; a pixel with a low threshold has more (v2e)
        rate = sensor.shot_noise_rate_hz / 2.0 * spread(Term.SHOT_RATE)
        values["shot_on"] = np.where(dead, 0.0, rate * _ease(sensor, sensor.pos_thres, on))
        values["shot_off"] = np.where(dead, 0.0, rate * _ease(sensor, sensor.neg_thres, off))
    if not terms.isdisjoint(("leak", "parasitic_leak", "hot_pixels")):
        one_hz = np.where(dead, 0.0, spread(Term.LEAK_RATE) * on * 1e-6)
        rate = one_hz * (sensor.leak_rate_hz * sensor.thermal_factor)
        if "hot_pixels" in terms:
            rate = rate + np.where(dead, 0.0, on * 1e-6) * tail_hz
        # at most one event a us, so that a hot chip does not exhaust the memory
        values["leak"] = np.round(np.minimum(rate, on) * GRID) / GRID
        if "parasitic_leak" in terms:
            values["parasitic"] = one_hz * sensor.parasitic_leak_hz
        leaks = (values["leak"] > 0.0) | (sensor.parasitic_leak_hz > 0.0)
        phase = pixel_uniforms(seed, Term.LEAK_PHASE, *size) * on
        values["phase"] = np.where(leaks & ~dead, phase, 0.0)
    arrays = {name: _constant(array, np.float32) for name, array in values.items()}
    if "refractory_spread" in terms and "refractory" in terms:
        cov = sensor.refractory_spread_decades
        relative = _log_normal(cov, seed, Term.REFRACTORY, size)
        periods = np.floor(relative * sensor.refractory_us + 0.5)
        arrays["refractory_us"] = _constant(np.clip(periods, 1, LONGEST_US), np.uint32)
    if "hot_pixels" in terms:
        arrays["hot"] = _constant(~dead & (tail_hz > HOT_LEAK_HZ), np.uint8)
    return FixedPattern(
        on=_constant(np.where(dead, np.inf, on), np.float32),
        off=_constant(np.where(dead, np.inf, off), np.float32),
        **arrays,
    )


def _log_normal(cov: float, seed: int, term: Term, size: tuple[int, int]) -> F64:
    """Numbers of mean 1 whose log10 has this deviation."""
    mean = math.exp((cov * math.log(10.0)) ** 2 / 2.0)
    return exp10(cov * pixel_normals(seed, term, *size)) / round(mean, 12)


def _ease(sensor: SensorParameters, nominal: float, theta: F64) -> F64:
    """How much more noise a pixel has for its lower threshold; its mean over pixels is 1."""
    return nominal / theta / _mean_ease(nominal, sensor.sigma_thres)


def _mean_ease(nominal: float, sigma: float) -> float:
    """Mean of nominal / max(floor, nominal + sigma N) over standard normal N."""
    points = [k / 64.0 for k in range(-8 * 64, 8 * 64 + 1)]
    weights = [math.exp(-0.5 * n * n) for n in points]
    eases = [nominal / max(floor(nominal), nominal + sigma * n) for n in points]
    mean = math.fsum(w * e for w, e in zip(weights, eases, strict=True)) / math.fsum(weights)
    return round(mean, 9)  # the same on every machine, whose exp may differ in the last bit


def _constant(values: Any, dtype: type) -> Any:
    array = on_lines(np.asarray(values, dtype))
    array.flags.writeable = False
    return array
