"""Pictures from events alone, by the complementary filter's high pass, and how true they are.

The filter is that of Scheerlinck, Barnes and Mahony (ACCV 2018) without frames: each pixel adds its
threshold at every event and forgets exponentially. It has a closed form between events, so nothing
here is stepped in time. Of log light itself it is a high pass, which is what it should give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
Stream = npt.NDArray[np.void]
"""events: fields t (us), x, y, p (1: ON)"""

WINDOW_PX, SIGMA_PX = 11, 1.5
"""of SSIM (Wang et al., TIP 2004), as are its constants"""


def of_events(
    events: Stream,
    shape: tuple[int, int],
    times_us: Sequence[int],
    threshold: float,
    cutoff_rad_s: float,
) -> F64:
    """Reconstruct log light from events; zero at 0 us.

    Args:
        events: In any order.
        shape: Height and width, px.
        times_us: When to read the state, ascending.
        threshold: What an event is worth, log units.
        cutoff_rad_s: How fast a pixel forgets, 1/s.

    Returns:
        (times, height, width) log units.
    """
    height, width = shape
    order = np.argsort(events["t"], kind="stable")
    t, x, y, p = (events[name][order].astype(np.int64) for name in "txyp")
    pixel = y * width + x
    step = np.where(p == 1, threshold, -threshold)
    ends = np.searchsorted(t, times_us, "right")
    state, begin, before_us, read = np.zeros(height * width), 0, 0, []
    for now_us, end in zip(times_us, ends, strict=True):
        age_s = 1e-6 * (now_us - t[begin:end])
        state *= np.exp(-cutoff_rad_s * 1e-6 * (now_us - before_us))
        weight = step[begin:end] * np.exp(-cutoff_rad_s * age_s)
        state += np.bincount(pixel[begin:end], weight, height * width)
        begin, before_us = end, now_us
        read.append(state.reshape(shape).copy())
    return np.stack(read)


def of_light(log_light: F64, tick_us: int, times_us: Sequence[int], cutoff_rad_s: float) -> F64:
    """Filter log light that is a straight line in each tick; zero at 0 us.

    Args:
        log_light: (ticks + 1, height, width), from 0 us on.
        tick_us: Between two of them.
        times_us: When to read the state: multiples of tick_us.
        cutoff_rad_s: As in `of_events`.

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
    scale = np.sqrt(power * float(np.mean(true**2)))
    return Fit(
        correlation=common / scale if scale else 0.0,
        ssim=ssim(matched, truth),
        mse=float(np.mean((matched - truth) ** 2)),
        picture=matched,
    )


def ssim(picture: F64, truth: F64) -> float:
    """Structural similarity with a Gaussian window; the truth's own span is the full scale."""
    span = float(np.ptp(truth))
    c1, c2 = (0.01 * span) ** 2, (0.03 * span) ** 2
    one, two = _blurred(picture), _blurred(truth)
    var_one = _blurred(picture * picture) - one * one
    var_two = _blurred(truth * truth) - two * two
    both = _blurred(picture * truth) - one * two
    likeness = (2 * one * two + c1) * (2 * both + c2)
    return float(np.mean(likeness / ((one**2 + two**2 + c1) * (var_one + var_two + c2))))


def _blurred(picture: F64) -> F64:
    """The Gaussian mean around each pixel whose window lies inside the picture."""
    away = np.arange(WINDOW_PX) - WINDOW_PX // 2
    weights = np.exp(-0.5 * (away / SIGMA_PX) ** 2)
    weights /= weights.sum()
    windows = np.lib.stride_tricks.sliding_window_view
    rows = windows(picture, WINDOW_PX, axis=0) @ weights
    return np.asarray(windows(rows, WINDOW_PX, axis=1) @ weights)
