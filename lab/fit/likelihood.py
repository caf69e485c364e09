"""Maximum likelihood of counts in bins, with standard errors, and the distributions that it needs.

NumPy alone: evs has no dependency with these functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs_lab.fit.observed import F64, I64

EXACT = 40
"""counts up to this have bins of their own and exact probabilities"""

LEAST = 1e-12
"""no bin has a smaller probability: one count there may not decide everything"""

STEP = 0.01
"""of numeric derivatives, of parameters that are logarithms"""

ROUNDS = 40


def bin_edges(largest: int) -> I64:
    """Upper ends of bins of counts: each count up to EXACT, then a factor of 1.15 each."""
    edges = list(range(EXACT + 1))
    while edges[-1] < largest:
        edges.append(math.ceil(edges[-1] * 1.15))
    return np.array(edges, np.int64)


def mixed_probabilities(
    edges: I64, regular: F64, poisson: F64, weight: F64, blur: float = 0.0
) -> F64:
    """(bins,) probability of each bin of a count, over a population of pixels.

    The count of a pixel is a regular train with a random phase and a Poisson process beside it.

    Args:
        edges: (bins,) upper ends; the last bin has no end.
        regular: (nodes,) mean number of regular events.
        poisson: (nodes,) mean number of others.
        weight: (nodes,) of each node, 1 in all.
        blur: what a node stands for, standard deviation over mean: so that nodes far apart do not
            show in large counts.
    """
    mean = regular + poisson
    low = mean < 3.0 * EXACT
    cumulative = np.zeros(len(edges))
    if low.any():
        exact = _cumulative(regular[low], poisson[low])
        cumulative[: EXACT + 1] += exact.T @ weight[low]
    high = ~low
    sigma = np.sqrt(poisson + 1.0 / 6.0 + (blur * mean) ** 2)
    for place, edge in enumerate(edges):
        chosen = high if place <= EXACT else slice(None)
        z = (edge + 0.5 - mean[chosen]) / sigma[chosen]
        cumulative[place] += weight[chosen] @ normal_cdf(z)
    cumulative[-1] = 1.0
    return np.maximum(np.diff(cumulative, prepend=0.0), LEAST)


def _cumulative(regular: F64, poisson: F64) -> F64:
    """(nodes, EXACT + 1) probability of at most so many events."""
    counts = np.arange(EXACT + 1)
    logs = counts * np.log(np.maximum(poisson, 1e-300))[:, None] - poisson[:, None] - _LOG_FACTORIAL
    others = np.cumsum(np.exp(logs), axis=1)
    # a regular train has its whole number, or one more
    whole = np.floor(regular).astype(np.int64)
    share = regular - whole
    padded = np.concatenate([np.zeros((len(regular), 1)), others], axis=1)
    places = counts[None, :] - whole[:, None] + 1
    some = np.take_along_axis(padded, np.maximum(places, 0), axis=1)
    fewer = np.take_along_axis(padded, np.maximum(places - 1, 0), axis=1)
    return np.asarray((1.0 - share)[:, None] * some + share[:, None] * fewer)


_LOG_FACTORIAL = np.array([math.lgamma(k + 1.0) for k in range(EXACT + 1)])


def normal_cdf(z: F64) -> F64:
    """Probability below z, to 1.5e-7 (Abramowitz and Stegun 7.1.26)."""
    x = np.abs(z) / math.sqrt(2.0)
    k = 1.0 / (1.0 + 0.3275911 * x)
    series = k * (
        0.254829592 + k * (-0.284496736 + k * (1.421413741 + k * (-1.453152027 + k * 1.061405429)))
    )
    tail = 0.5 * series * np.exp(-np.minimum(x * x, 700.0))
    return np.asarray(np.where(z >= 0.0, 1.0 - tail, tail))


Probabilities = Callable[[F64], F64]
"""parameters -> (bins,) probabilities"""


@dataclass(frozen=True)
class Fit:
    """A maximum of the likelihood."""

    parameters: F64
    log_likelihood: float


def fit_bins(bins: I64, probabilities: Probabilities, start: F64, bounds: tuple[F64, F64]) -> Fit:
    """Fit parameters to the bins that pixels fall in, by Fisher's scoring with damping.

    Args:
        bins: (pixels,) bin of each pixel.
        probabilities: Of the bins, for any parameters within the bounds.
        start: (k,) first guess.
        bounds: (k,) lowest and highest values.
    """
    low, high = bounds
    point = np.clip(start, low, high)
    held = np.bincount(bins)
    places = np.flatnonzero(held)
    weight = held[places].astype(np.float64)

    def value(at: F64) -> float:
        return float(weight @ np.log(probabilities(at)[places]))

    now, damping = value(point), 1e-3
    for _ in range(ROUNDS):
        slopes = log_slopes(probabilities, point)[places]
        gradient, information = weight @ slopes, slopes.T @ (weight[:, None] * slopes)
        scale = np.diag(np.diag(information) + 1e-9)
        gain = 0.0
        while damping < 1e6:
            step = np.linalg.solve(information + damping * scale, gradient)
            after = np.clip(point + np.clip(step, -1.0, 1.0), low, high)
            better = value(after)
            if better > now:
                gain, point, now = better - now, after, better
                damping = max(damping / 5.0, 1e-6)
                break
            damping *= 8.0
        if gain < (1e-2 if damping < 1.0 else 1e-5):
            break
    return Fit(point, now)


def log_slopes(probabilities: Probabilities, point: F64) -> F64:
    """(bins, k) derivatives of the logarithms of the probabilities."""
    slopes = []
    for k in range(len(point)):
        offset = np.zeros(len(point))
        offset[k] = STEP
        ahead, behind = probabilities(point + offset), probabilities(point - offset)
        slopes.append((np.log(ahead) - np.log(behind)) / (2.0 * STEP))
    return np.array(slopes).T


def stages_covariance(stages: list[tuple[I64, Probabilities, list[int]]], point: F64) -> F64:
    """(k, k) covariance of parameters that were fitted in stages, NaN where nothing fixes them.

    A later stage takes the parameters of the earlier ones as they are; their errors are part of
    its own. The counts of a pixel need not be independent between stages (Huber 1967).

    Args:
        stages: for each, (pixels,) bins, the probabilities of all parameters, and which
            parameters it has fitted.
        point: (k,) all parameters.
    """
    size = len(point)
    information = np.zeros((size, size))
    scores = np.zeros((len(stages[0][0]), size))
    for bins, probabilities, own in stages:
        slopes, share = log_slopes(probabilities, point), probabilities(point)
        information[own] = len(bins) * (slopes[:, own] * share[:, None]).T @ slopes
        scores[:, own] = slopes[bins][:, own]
    try:
        inverse = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        return np.full((size, size), np.nan)
    return np.asarray(inverse @ (scores.T @ scores) @ inverse.T)
