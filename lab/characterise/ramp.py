"""Ramp contrast thresholds: by how much light changes between two events of a pixel on a slow ramp.

Prophesee's data sheets name them RCT, with their non-uniformity RCTNU. As users quote them, light
rises from L_min to L_max and falls again, a pixel has n events of a polarity on its way, and its
RCT is (L_max / L_min)^(1 / n) - 1. Here n is what the usual interval of its events gives for the
whole ramp, so that it is no whole number and the events that its noise adds do not count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs_lab.characterise.bench import F64, Bench, pixel_numbers
from evs_lab.characterise.expected import ramp_contrast
from evs_lab.characterise.quantity import Quantity

LOW_LUX, HIGH_LUX = 10.0, 1000.0
"""The ends of the ramp: those of Prophesee's triangle."""

SECONDS = 1.0
"""A slope takes so long: slow for the filters of a pixel, fast for its leak."""

TICKS = 500
"""Of a slope; log light is a straight line in each."""

LEAST_INTERVALS = 3
"""between the events of a pixel that counts"""

SLOPE = math.log(HIGH_LUX / LOW_LUX) / SECONDS
"""Log units a second."""

MIDDLE_LUX = math.sqrt(LOW_LUX * HIGH_LUX)


@dataclass(frozen=True)
class Ramp:
    """The ramp contrast thresholds of one polarity, as Weber contrasts."""

    threshold: tuple[float, float]
    """RCT: the median over the pixels, its standard error; NaN: too few events"""
    spread: tuple[float, float]
    """RCTNU: standard deviation over the pixels, its standard error"""
    contrast: F64
    """(h, w) RCT of each pixel; NaN: too few events"""


@dataclass(frozen=True)
class RampThresholds:
    """Both polarities of a sensor."""

    on: Ramp
    off: Ramp

    def results(self, sensor: SensorParameters) -> list[Quantity]:
        """RCT and RCTNU of both polarities, in percent of Weber contrast."""
        found = []
        for name, ramp, on in (("ON", self.on, True), ("OFF", self.off, False)):
            mean, spread = ramp_contrast(sensor, on, MIDDLE_LUX, SLOPE)
            note = "too few events" if math.isnan(ramp.threshold[0]) else ""
            for what, (measured, error), promised in (
                ("ramp threshold, RCT", ramp.threshold, mean),
                ("ramp non-uniformity, RCTNU", ramp.spread, spread),
            ):
                numbers = (100.0 * measured, 100.0 * error, 100.0 * promised)
                found.append(Quantity(f"{name} {what}", "%", *numbers, MIDDLE_LUX, note))
        return found


def measure_ramp(bench: Bench) -> RampThresholds:
    """Measure both polarities: one slope upwards, one downwards."""
    return RampThresholds(_slope(bench, True), _slope(bench, False))


def _slope(bench: Bench, on: bool) -> Ramp:
    first, last = (LOW_LUX, HIGH_LUX) if on else (HIGH_LUX, LOW_LUX)
    exposure = bench.start(first, round(SECONDS * 1e6))
    pixels, times = [], []
    for lux in np.geomspace(first, last, TICKS + 1)[1:]:
        events = exposure.expose(float(lux), round(SECONDS / TICKS * 1e6))
        events = events[events["p"] == on]
        pixels.append(pixel_numbers(events, bench.sensor))
        times.append(events["t"])
    interval_s = usual_intervals(np.concatenate(pixels), np.concatenate(times), bench.pixels) * 1e-6
    contrast = np.expm1(SLOPE * interval_s)
    shape = (bench.sensor.height, bench.sensor.width)
    return summarise(contrast.reshape(shape))


def usual_intervals(pixel: np.ndarray, t_us: np.ndarray, pixels: int) -> F64:
    """The median interval of each pixel's events.

    Args:
        pixel: (n,) number of the pixel of each event.
        t_us: (n,) their times.
        pixels: how many there are.

    Returns:
        (pixels,) us; NaN where there are fewer than LEAST_INTERVALS.
    """
    order = np.lexsort((t_us, pixel))
    same = np.diff(pixel[order]) == 0
    owner, interval = pixel[order][1:][same], np.diff(t_us[order])[same].astype(np.float64)
    interval = interval[np.lexsort((interval, owner))]
    count = np.bincount(owner, minlength=pixels)
    first = np.cumsum(count) - count
    enough = count >= LEAST_INTERVALS
    low, high = (first[enough] + (count[enough] - 1 + k) // 2 for k in (0, 1))
    found = np.full(pixels, np.nan)
    found[enough] = 0.5 * (interval[low] + interval[high])
    return found


def summarise(contrast: F64) -> Ramp:
    """Median and standard deviation over the pixels that have a threshold."""
    there = contrast[np.isfinite(contrast)]
    if len(there) < 2:
        nothing = (math.nan, math.nan)
        return Ramp(nothing, nothing, contrast)
    sigma = float(there.std())
    fourth = float(((there - there.mean()) ** 4).mean())
    # of the median of nearly normal values, and of a standard deviation
    error = math.sqrt(math.pi / 2.0 / len(there)) * sigma
    sigma_error = math.sqrt(max(fourth - sigma**4, 0.0) / len(there)) / (2.0 * sigma or 1.0)
    return Ramp((float(np.median(there)), error), (sigma, sigma_error), contrast)
