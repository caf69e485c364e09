"""How many events, and where: count ratios and per-pixel rate maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import Events, EvsError
from evs_lab.metrics.window import Window

I64 = npt.NDArray[np.int64]

_PRIOR = 0.5


@dataclass(frozen=True)
class CountRatio:
    """Events per reference event; 1 is right. NaN if the reference has none."""

    on: float
    off: float
    all: float


@dataclass(frozen=True)
class RateMaps:
    """How two maps of event rates over the pixels differ. Both polarities together."""

    rmse_hz: float
    """root of the mean squared difference of the rates, events per s of one pixel"""
    kl_nats: float
    """Kullback-Leibler divergence of where events fall, reference against events; 0 is equal"""
    correlation: float
    """Pearson's, over pixels; NaN if one of the maps is the same everywhere"""


def count_ratio(events: Events, reference: Events) -> CountRatio:
    """Ratio of event counts by polarity; (n,) and (m,) EVENT_DTYPE of one window."""

    def ratio(count: int, of: int) -> float:
        return count / of if of else float("nan")

    on, of_on = (int(np.count_nonzero(part["p"] == 1)) for part in (events, reference))
    off, of_off = len(events) - on, len(reference) - of_on
    return CountRatio(ratio(on, of_on), ratio(off, of_off), ratio(on + off, of_on + of_off))


def count_map(events: Events, window: Window) -> I64:
    """Events per pixel, (height, width) int64; the events are inside the window (`window.cut`)."""
    counts = np.bincount(window.pixel_index(events), minlength=window.pixels)
    return counts.reshape(window.height, window.width).astype(np.int64)


def count_loss(counts: I64, reference_counts: I64) -> float:
    """L_count, the paper's equation (10): |sum |S_i| - sum |E_i||, here the mean over pixels.

    Args:
        counts: (height, width) events per pixel, both polarities
        reference_counts: the same of the reference

    Returns:
        events per pixel
    """
    _check_shapes(counts, reference_counts)
    return float(np.mean(np.abs(counts - reference_counts)))


def compare_rate_maps(counts: I64, reference_counts: I64, duration_s: float) -> RateMaps:
    """The distance of two maps of counts, as rates.

    The divergence is sum P ln(P / Q) over pixels, P the reference, Q the events, each the share of
    all events that falls on a pixel. Half an event is added to every pixel of both, so that it is
    finite: a pixel without events is not known never to have one. It sees only where events are,
    not how many. The definitions are ours: figures that others publish may be normalised otherwise.

    Args:
        counts: (height, width) events per pixel (`count_map`)
        reference_counts: the same of the reference
        duration_s: over which they were counted

    Raises:
        EvsError: the shapes differ or there is no time
    """
    _check_shapes(counts, reference_counts)
    if not duration_s > 0:
        raise EvsError(f"duration_s is {duration_s:g}; give the seconds that were counted")
    difference = (counts - reference_counts) / duration_s
    q, p = (_shares(part) for part in (counts, reference_counts))
    return RateMaps(
        rmse_hz=float(np.sqrt(np.mean(difference**2))),
        # rounding may leave equal maps a hair below zero
        kl_nats=max(0.0, float(np.sum(p * np.log(p / q)))),
        correlation=_correlation(counts, reference_counts),
    )


def _shares(counts: I64) -> npt.NDArray[np.float64]:
    raised = counts + _PRIOR
    shares: npt.NDArray[np.float64] = raised / raised.sum()
    return shares


def _correlation(first: I64, second: I64) -> float:
    """Pearson's correlation over all pixels; NaN where it is not defined."""
    if first.min() == first.max() or second.min() == second.max():
        return float("nan")
    a, b = first - first.mean(), second - second.mean()
    value = float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return min(1.0, max(-1.0, value))


def _check_shapes(counts: I64, reference_counts: I64) -> None:
    if counts.shape != reference_counts.shape or not counts.size:
        raise EvsError(
            f"maps of {counts.shape} and {reference_counts.shape} px; give two of one size"
        )
