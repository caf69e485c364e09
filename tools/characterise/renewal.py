"""Leak under shot noise: each noise event restarts the leak of its pixel, which hides some leak."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

HANN = 1.5
"""Mean square of Hann's window: by so much more than counts do their weighted sums vary."""

SURE = 5.0
"""An excess of ON events of fewer standard errors is none."""

MOST_NOISE = 4.0
"""With more noise events than that for each leak event, the few that are left tell too little."""


@dataclass(frozen=True)
class Spreads:
    """Of log-normal rates over pixels: standard deviations of ln."""

    leak: float
    shot: float


def leak_without_noise(
    excess: tuple[float, float], shot: tuple[float, float], spreads: Spreads
) -> tuple[float, float]:
    """(L, standard error): the leak rate behind an excess d of ON events under noise of rate s.

    A pixel leaks where noise is silent for 1 / L, so that d = s / (exp(s / L) - 1); here in the
    mean over pixels whose L and s are log-normal. NaN where d is lost in the noise.
    In: (d, standard error), (s, standard error).
    """
    (d, d_error), (s, s_error) = excess, shot
    if not s > 0.0:
        return excess
    if not d > SURE * d_error:
        return math.nan, math.nan
    leak = _solve(d, s, spreads)
    if s > MOST_NOISE * leak:
        return math.nan, math.nan
    by_d = _solve(d + d_error, s, spreads) - leak
    by_s = _solve(d, s + s_error, spreads) - leak
    return leak, math.hypot(by_d, by_s)


def _solve(d: float, s: float, spreads: Spreads) -> float:
    """L, by halving its logarithm; it is over d."""
    low, high = 0.0, math.log(1e6)
    for _ in range(50):
        middle = 0.5 * (low + high)
        enough = mean_excess(d * math.exp(middle), s, spreads) > d
        low, high = (low, middle) if enough else (middle, high)
    return d * math.exp(high)


def mean_excess(leak: float, shot: float, spreads: Spreads) -> float:
    """Leak events of a pixel and second under noise, mean over log-normal rates of these means."""
    z = np.linspace(-4.0, 4.0, 33)
    weight = np.exp(-0.5 * z * z)
    weight /= weight.sum()

    def rates(mean: float, spread: float) -> F64:
        return np.asarray(mean * np.exp(spread * z - 0.5 * spread**2))

    leaks = rates(leak, spreads.leak)[np.newaxis, :]
    s = rates(shot, spreads.shot)[:, np.newaxis]
    return float(weight @ (s / np.expm1(np.minimum(s / leaks, 500.0))) @ weight)


def find_spreads(off: F64, seconds: float, unevenness: float) -> Spreads:
    """From the rates of the pixels' OFF events, which are all noise.

    Chance in their counts is taken off, and what thresholds do, which leak does not know and of
    which each polarity has its own.

    Args:
        off: events of each pixel.
        seconds: duration.
        unevenness: of thresholds, standard deviation over mean.
    """
    mean = float(off.mean())
    if not mean > 0.0:
        return Spreads(0.0, 0.0)
    chance = HANN * mean / seconds
    whole = math.log1p(max(float(off.var()) - chance, 0.0) / mean**2)
    # of 1 / theta: its variance over its mean squared
    thresholds = unevenness**2 + 8.0 * unevenness**4
    own = max(whole - thresholds, 0.0)
    return Spreads(math.sqrt(own), math.sqrt(own + min(0.5 * thresholds, whole)))
