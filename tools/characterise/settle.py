"""Pixels brought to rest: the reference of each one is the light that it sees.

Leak, and what light has left over, put a pixel's reference anywhere between two events. An event
puts it where the light is. So each pixel is shown a fall of light that is just enough for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs.tools.characterise.bench import F64, Bench, LightExposure, Mask, answered, pixel_numbers
from evs.tools.characterise.expected import time_constants_s

TIME_CONSTANTS = 9.0
"""How long the bench waits for an answer; e^-9 of a step is still to come then."""

LEAST_WINDOW_US = 16
MOST_WINDOW_US = 2e7
"""The bench has no patience for slower pixels; they answer to what came through."""

FIRST_CONTRAST = 0.05
MOST_CONTRAST = 14.0
"""No pixel is asked for more, ln of the ratio of light."""

HALVINGS = 13
"""So a pixel's least contrast is known to 1 / 8192 of it."""


@dataclass
class Settled:
    """A sensor at rest in uniform light."""

    exposure: LightExposure
    lux: float
    sound: Mask
    """(h w,) pixels that settled"""
    dead: Mask
    """(h w,) pixels that answered nothing; noise spoke in the others that did not settle"""

    def step(self, lux: float | F64, on: bool) -> Mask:
        """(h w,) which pixels answer with this polarity to a step of the light; nothing changes."""
        exposure = self.exposure.copy()
        mask = np.zeros(exposure.bench.pixels, bool)
        for us in window_us(exposure.bench, self.lux):
            mask |= answered(exposure.expose(lux, us), exposure.bench.sensor, on)
        return mask

    def quiet(self) -> Mask:
        """(h w,) pixels that settled and do not speak while nothing happens."""
        return self.sound & ~self.step(self.lux, True) & ~self.step(self.lux, False)


def window_us(bench: Bench, lux: float) -> list[int]:
    """Ticks in which a step has come through; the light takes the first one to change."""
    sensor = bench.sensor
    slowest = sum(time_constants_s(sensor, lux)) * 1e6
    total = max(LEAST_WINDOW_US, math.ceil(min(TIME_CONSTANTS * slowest, MOST_WINDOW_US)))
    if sensor.filter == "euler":
        # such a step must be short against the time constant
        marks = np.unique(np.linspace(0, total, 101).round().astype(int))
        return [1, *np.diff(marks).tolist()]
    return growing_us(total, 1.0)


def growing_us(total_us: int, share: float) -> list[int]:
    """Ticks for what slows down after a step: each is this share of the time since then."""
    ticks: list[int] = []
    passed = 0
    while passed < total_us:
        ticks.append(min(max(1, math.floor(share * passed)), total_us - passed))
        passed += ticks[-1]
    return ticks


def settle(bench: Bench, lux: float, wait_us: int = 1) -> Settled:
    """Every pixel at rest in this light.

    In: wait_us, how long to wait before; then the noise that some pixels spoke in is over.
    """
    sensor = bench.sensor
    window = window_us(bench, lux)

    def fall(contrast: F64) -> tuple[LightExposure, Mask]:
        exposure = bench.start(lux * np.exp(contrast), wait_us)
        mask = np.zeros(bench.pixels, bool)
        for us in window:
            mask |= answered(exposure.expose(lux, us), sensor, False)
        return exposure, mask

    # where noise speaks meanwhile, nobody knows what the reference is
    noisy = np.zeros(bench.pixels, bool)
    exposure = bench.start(lux, wait_us)
    for us in window:
        noisy[pixel_numbers(exposure.expose(lux, us), sensor)] = True
    enough = least_contrast(lambda contrast: fall(contrast)[1] | noisy, bench.pixels)
    sound = np.isfinite(enough) & ~noisy
    exposure, fired = fall(np.where(sound, enough, 0.0))
    # whoever has just fired is blind for a while
    rest_us = LEAST_WINDOW_US + math.ceil(sensor.refractory_period_s * 1e6)
    sound &= fired
    sound[pixel_numbers(exposure.expose(lux, rest_us), sensor)] = False
    return Settled(exposure, lux, sound, np.isnan(enough))


def least_contrast(answers: Callable[[F64], Mask], pixels: int) -> F64:
    """(h w,) the least contrast that each pixel answers; NaN: none up to MOST_CONTRAST.

    First doubled until it does, then halved between.

    Args:
        answers: of one contrast a pixel, whether it answers.
        pixels: the pixels.
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
