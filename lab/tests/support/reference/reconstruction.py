"""What the complementary filter of events should give, and how true its pictures are.

Of log light itself lab/reconstruction/filter.py is a high pass, which is what it should give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs_lab.reconstruction import correlation, ssim

F64 = npt.NDArray[np.float64]


def of_light(log_light: F64, tick_us: int, times_us: Sequence[int], cutoff_rad_s: float) -> F64:
    """Filter log light that is a straight line in each tick; zero at 0 us.

    Args:
        log_light: (ticks + 1, height, width), from 0 us on.
        tick_us: Between two of them.
        times_us: When to read the state: multiples of tick_us.
        cutoff_rad_s: See `complementary_filter`.

    Returns:
        (times, height, width) log units.
    """
    forget = 1e-6 * tick_us * cutoff_rad_s
    kept, gained = np.exp(-forget), -np.expm1(-forget) / forget
    state, found = np.zeros_like(log_light[0]), {0: np.zeros_like(log_light[0])}
    for k in range(1, len(log_light)):
        state = kept * state + gained * (log_light[k] - log_light[k - 1])
        if k * tick_us in times_us:
            found[k * tick_us] = state
    return np.stack([found[t] for t in times_us])


@dataclass(frozen=True)
class Fit:
    """A picture beside the true one, after the best gain (0 or more) and offset."""

    correlation: float
    ssim: float
    mse: float
    """log units squared"""
    picture: F64
    """(h, w) log units, with gain and offset"""


def fit(picture: F64, truth: F64) -> Fit:
    """Match a picture to the truth by least squares, then judge it.

    Args:
        picture: (h, w) in any unit; one without contrast becomes the mean of the truth.
        truth: (h, w) log light.
    """
    own, true = picture - picture.mean(), truth - truth.mean()
    power, common = float(np.mean(own**2)), float(np.mean(own * true))
    gain = max(common, 0.0) / power if power else 0.0
    matched = truth.mean() + gain * own
    return Fit(
        correlation=correlation(picture, truth),
        ssim=ssim(matched, truth),
        mse=float(np.mean((matched - truth) ** 2)),
        picture=matched,
    )
