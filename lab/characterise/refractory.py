"""The refractory period: two steps of light, closer and closer, until the second has no event."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs_lab.characterise.bench import Bench, pixel_numbers, share_of
from evs_lab.characterise.quantity import Quantity
from evs_lab.characterise.settle import growing_us, window_us

LUX = 1000.0
STEP = 5.0
"""Each step, ln of the ratio of light: many thresholds, and then so bright that pixels are fast."""

CLOCKS_US = 2
"""Two stamps are rounded to microseconds: so much of a difference is none."""

NOISE = 0.01
"""A smaller share of the pixels may speak for reasons of their own."""

LONGEST_US = 1 << 28
AFTER_US = (0, 1, 2, 4, 8, 16, 32, 64, 128, 256)
"""Delays after the shortest one that are tried too: a slow pixel may answer sooner there."""

TIMES = (1.3, 1.6, 2.0, 2.4, 2.8)
"""The shortest one times these: there the step alone decides."""

GROWTH = 0.2
"""Ticks grow with the time since the first step, by which the pixel slows down."""

PIXELS = 4096


@dataclass(frozen=True)
class Refractory:
    """Shortest interval between two events of a pixel."""

    shortest_us: int
    """-1: no pixel answered twice"""
    period_us: float
    """how long every pixel was blind"""
    error_us: float
    delays_us: list[int]
    """between the two steps, as they were tried"""
    intervals_us: list[int]
    """shortest interval between two events of a pixel then; -1: none"""

    def results(self, sensor: SensorParameters) -> list[Quantity]:
        """The longest time after an event for which every pixel was blind."""
        promised = sensor.refractory_period_s
        runs_us = sensor.refractory_us
        note = (
            "" if abs(promised * 1e6 - runs_us) < 1e-6 else f"the pixel counts whole us: {runs_us}"
        )
        if self.shortest_us < 0:
            nothing = "no pixel answered twice"
            return [Quantity("refractory period", "s", math.nan, math.nan, promised, None, nothing)]
        measured = self.period_us * 1e-6
        error = self.error_us * 1e-6
        return [Quantity("refractory period", "s", measured, error, promised, None, note)]


def measure_refractory(bench: Bench) -> Refractory:
    """Bisect the delay of the second step; on a corner of the sensor, whose pixels are alike."""
    part = bench.part(PIXELS)
    tried = _try_delays(part, STEP)
    delays = sorted(tried)
    intervals = [tried[delay][1] for delay in delays]
    shortest = _shortest(tried)
    if shortest < 0:
        return Refractory(-1, math.nan, math.nan, delays, intervals)
    # what a step of half the height takes longer, the whole one takes too: a slow pixel must
    # climb a threshold once it sees again
    gentle = _shortest(_try_delays(part, 0.5 * STEP))
    climb = gentle - shortest
    climb = climb if climb > CLOCKS_US else 0
    # an event of the next microsecond is the first that is possible
    period = max(shortest - climb - 1, 0)
    return Refractory(shortest, period, 0.5 + 0.5 * climb, delays, intervals)


Tried = dict[int, tuple[float, int]]
"""delay of the second step, us -> (share that answered both, shortest interval or -1)"""


def _try_delays(bench: Bench, step: float) -> Tried:
    tried: Tried = {}

    def answers(delay_us: int) -> bool:
        if delay_us not in tried:
            tried[delay_us] = _pair(bench, step, delay_us)
        return tried[delay_us][0] > NOISE

    longest = 1
    while not answers(longest) and longest < LONGEST_US:
        longest *= 4
    blind, sees = 0, longest
    while sees - blind > 1:
        middle = (blind + sees) // 2
        blind, sees = (blind, middle) if answers(middle) else (middle, sees)
    for after in AFTER_US:
        answers(sees + after)
    for times in TIMES:
        answers(round(times * sees))
    return tried


def _shortest(tried: Tried) -> int:
    return min((interval for _, interval in tried.values() if interval >= 0), default=-1)


def _pair(bench: Bench, step: float, delay_us: int) -> tuple[float, int]:
    """(share that answers both steps, the shortest interval of any pixel or -1)."""
    exposure = bench.start(LUX)
    brighter, brightest = LUX * math.exp(step), LUX * math.exp(2.0 * step)
    # both steps take a microsecond; then microseconds, for stamps as fine as they go
    steps = [(brighter, us) for us in growing_us(delay_us, GROWTH)]
    steps += [(brightest, 1)] * (1 + min(sum(window_us(bench, LUX)), 64))
    second_us = 1 + exposure.t_us + delay_us
    events = np.concatenate([exposure.expose(lux, us) for lux, us in steps])
    events = events[events["p"] == 1]
    pixel, t = pixel_numbers(events, bench.sensor), events["t"]
    first, second = np.zeros((2, bench.pixels), bool)
    first[pixel[t < second_us]] = True
    second[pixel[t >= second_us]] = True
    order = np.lexsort((t, pixel))
    same = np.diff(pixel[order]) == 0
    intervals = np.diff(t[order])[same]
    return share_of(second, first), int(intervals.min()) if len(intervals) else -1
