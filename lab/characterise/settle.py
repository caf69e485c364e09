"""Pixels brought to rest: the reference of each one is the light that it sees.

Leak and earlier light leave a pixel's reference anywhere between two events. An event sets it to
the present light. So each pixel is shown a fall of light that is just enough for one event.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs_lab.characterise.bench import F64, Bench, LightExposure, Mask, answered, pixel_numbers
from evs_lab.characterise.expected import time_constants_s

TIME_CONSTANTS = 9.0
"""how long the bench waits for a response; e^-9 of a step is then still to come"""

LEAST_WINDOW_US = 16
MOST_WINDOW_US = 2e7
"""longest wait; slower pixels respond to the part of a step that has come through"""

FIRST_CONTRAST = 0.05
MOST_CONTRAST = 14.0
"""largest contrast that is tried, ln of the ratio of light"""

HALVINGS = 13
"""the least contrast of a pixel is then known to 1 / 8192 of it"""


@dataclass
class Settled:
    """A sensor at rest in uniform light."""

    exposure: LightExposure
    lux: float
    sound: Mask
    """(h w,) pixels that settled"""
    dead: Mask
    """(h w,) pixels that never responded; the others that did not settle had noise events"""

    def step(self, lux: float | F64, on: bool) -> Mask:
        """(h w,) which pixels respond to a step of light with this polarity; the state is kept."""
        exposure = self.exposure.copy()
        mask = np.zeros(exposure.bench.pixels, bool)
        for us in window_us(exposure.bench, self.lux):
            mask |= answered(exposure.expose(lux, us), exposure.bench.sensor, on)
        return mask

    def quiet(self) -> Mask:
        """(h w,) pixels that settled and have no event in constant light."""
        return self.sound & ~self.step(self.lux, True) & ~self.step(self.lux, False)


def window_us(bench: Bench, lux: float) -> list[int]:
    """Ticks in which a step comes through, us; the light changes in the first one."""
    sensor = bench.sensor
    slowest = sum(time_constants_s(sensor, lux)) * 1e6
    total = max(LEAST_WINDOW_US, math.ceil(min(TIME_CONSTANTS * slowest, MOST_WINDOW_US)))
    if sensor.filter == "euler":
        # such a step must be short against the time constant
        marks = np.unique(np.linspace(0, total, 101).round().astype(int))
        return [1, *np.diff(marks).tolist()]
    return growing_us(total, 1.0)


def growing_us(total_us: int, share: float) -> list[int]:
    """Ticks that grow after a step, us: each lasts this share of the time since the step."""
    ticks: list[int] = []
    passed = 0
    while passed < total_us:
        ticks.append(min(max(1, math.floor(share * passed)), total_us - passed))
        passed += ticks[-1]
    return ticks


def settle(bench: Bench, lux: float, wait_us: int = 1) -> Settled:
    """Bring every pixel to rest in this light.

    Args:
        bench: the bench with the sensor.
        lux: illuminance.
        wait_us: how long to wait before, until the noise that disturbed some pixels has passed.
    """
    sensor = bench.sensor
    window = window_us(bench, lux)

    def fall(contrast: F64) -> tuple[LightExposure, Mask]:
        exposure = bench.start(lux * np.exp(contrast), wait_us)
        mask = np.zeros(bench.pixels, bool)
        for us in window:
            mask |= answered(exposure.expose(lux, us), sensor, False)
        return exposure, mask

    # the reference of a pixel with noise events is not known
    noisy = np.zeros(bench.pixels, bool)
    exposure = bench.start(lux, wait_us)
    for us in window:
        noisy[pixel_numbers(exposure.expose(lux, us), sensor)] = True
    enough = least_contrast(lambda contrast: fall(contrast)[1] | noisy, bench.pixels)
    sound = np.isfinite(enough) & ~noisy
    exposure, fired = fall(np.where(sound, enough, 0.0))
    # a pixel that has just fired is blind for a while
    rest_us = LEAST_WINDOW_US + math.ceil(sensor.refractory_period_s * 1e6)
    sound &= fired
    sound[pixel_numbers(exposure.expose(lux, rest_us), sensor)] = False
    return Settled(exposure, lux, sound, np.isnan(enough))


def least_contrast(answers: Callable[[F64], Mask], pixels: int) -> F64:
    """(h w,) the least contrast to which each pixel responds; NaN: none up to MOST_CONTRAST.

    The contrast is doubled until a pixel responds, then found by bisection.

    Args:
        answers: which pixels respond to (h w,) contrasts, one for each.
        pixels: how many there are.
    """
    none = np.zeros(pixels)
    enough = np.full(pixels, FIRST_CONTRAST)
    found = answers(enough)
    while not found.all() and enough.max() < MOST_CONTRAST:
        none = np.where(found, none, enough)
        enough = np.where(found, enough, np.minimum(2.0 * enough, MOST_CONTRAST))
        found |= answers(enough)
    for _ in range(HALVINGS):
        middle = 0.5 * (none + enough)
        yes = answers(middle)
        none, enough = np.where(yes, none, middle), np.where(yes, middle, enough)
    return np.where(found, enough, np.nan)
