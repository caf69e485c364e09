"""The period of a light that changes evenly, and its flanks, from the events alone."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from evs.msgs import EvsError
from evs_lab.fit.observed import F64, I64, Observed

BIN_US = 500
MAX_BINS = 1 << 25
"""4.7 hours"""
FEWEST_PERIODS = 3
LEAST_SHARE = 0.3
"""of the variance of the light that the period must explain"""


def find_period_s(seen: Observed) -> float:
    """The period at which ON and OFF events take turns.

    Raises:
        EvsError: The recording has none, or fewer than FEWEST_PERIODS.
    """
    # the sum of the events follows the light, whose own period is stronger than its harmonics
    rate = _rate(seen)
    light = np.cumsum(rate - rate.mean())
    window = np.hanning(len(rate)) * (light - light.mean())
    size = 1 << (8 * len(window)).bit_length()
    power = np.abs(np.fft.rfft(window, size)) ** 2
    lowest = math.ceil(FEWEST_PERIODS * size / len(rate))
    if lowest >= len(power) - 1 or not window.any():
        raise EvsError(
            f"{seen.source}: {seen.seconds:.3g} s are too short for a period; record 10 periods"
        )
    best = lowest + int(power[lowest:].argmax())
    # the maximum of a parabola through the logarithms
    around = np.log(power[best - 1 : best + 2] + 1e-300)
    bend = float(around[0] - 2.0 * around[1] + around[2])
    shift = 0.5 * float(around[0] - around[2]) / bend if bend < 0.0 else 0.0
    width = 4 * size // len(rate)
    held = float(power[max(best - width, 0) : best + width].sum())
    if held < LEAST_SHARE * float(power.sum()):
        raise EvsError(
            f"{seen.source}: ON and OFF events do not take turns; give --period, or record a light "
            "that changes evenly"
        )
    return size / (best + shift) * BIN_US * 1e-6


def _rate(seen: Observed) -> F64:
    """ON less OFF events in bins of BIN_US."""
    place = ((seen.events["t"] - seen.events["t"][0]) // BIN_US).astype(np.int64)
    if int(place[-1]) >= MAX_BINS:
        raise EvsError(
            f"{seen.source} lasts {int(place[-1]) * BIN_US * 1e-6:.0f} s, too long to find the "
            "period of the light: give --period, or cut it"
        )
    sign = np.where(seen.on, 1.0, -1.0)
    return np.asarray(np.bincount(place, sign), np.float64)


def flanks_us(seen: Observed, period_s: float) -> tuple[I64, I64]:
    """(rises, falls) where the light of a blinking lamp changes, us, each for its own lamp period.

    A flank is the moment from which a twentieth of the events of its burst have come.

    Args:
        seen: A blinking lamp.
        period_s: Of the lamp.
    """
    t_us = seen.events["t"].astype(np.int64)
    bins = max(round(1e6 * period_s / BIN_US), 8)
    found = []
    for polarity in (seen.on, ~seen.on):
        times = t_us[polarity]
        if not len(times):
            found.append(np.zeros(0, np.int64))
            continue
        # where in the period the burst begins: after the quiet half
        phase = (times - t_us[0]) / (1e6 * period_s) % 1.0
        fold = np.bincount((phase * bins).astype(np.int64), minlength=bins)[:bins]
        half = np.convolve(np.concatenate([fold, fold]), np.ones(bins // 2))[
            bins // 2 : bins + bins // 2
        ]
        begin = (int(half.argmax()) + 1) % bins / bins - 0.05
        edges = np.arange(t_us[0] + begin * 1e6 * period_s, t_us[-1], 1e6 * period_s)
        starts = [_onset(times, low, high) for low, high in pairwise(edges)]
        found.append(np.array([at for at in starts if at >= 0], np.int64))
    return found[0], found[1]


def _onset(times: I64, low: float, high: float) -> int:
    inside = times[np.searchsorted(times, low) : np.searchsorted(times, high)]
    return int(inside[len(inside) // 20]) if len(inside) else -1
