"""Fits, with their standard errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.emulator.sensor.noise_rate import normal_cdf

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Normal:
    """A fitted normal distribution and its standard errors."""

    mean: float
    sigma: float
    mean_error: float
    sigma_error: float


def normal_pdf(z: float) -> float:
    """Density at z."""
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


def fit_normal(edges: F64, counts: F64) -> Normal:
    """Fit a normal distribution to counts by maximum likelihood, with Fisher's scoring.

    This is the probit fit if each individual is tested at every edge (Finney 1971, grouped data).
    Counts in fewer than three places define no sigma: it is 0, within the distance of the edges.

    Args:
        edges: (k,) ascending.
        counts: (k + 1,), below the first, between, and above the last.
    """
    total = counts.sum()
    held = np.flatnonzero(counts)
    if len(held) < 3:
        return _narrow(edges, held)
    inner = counts[1:-1]
    middles = 0.5 * (edges[1:] + edges[:-1])
    weights = inner / inner.sum()
    mean = float(weights @ middles)
    sigma = max(math.sqrt(float(weights @ (middles - mean) ** 2)), 1e-3 * (edges[-1] - edges[0]))
    information = np.eye(2)
    for _ in range(100):
        z = (edges - mean) / sigma
        cdf = np.array([0.0, *map(normal_cdf, z), 1.0])
        pdf = np.array([0.0, *map(normal_pdf, z), 0.0])
        z_pdf = np.array([0.0, *(pdf[1:-1] * z), 0.0])
        share = np.maximum(np.diff(cdf), 1e-300)
        # of each share, by the mean and by sigma
        slopes = np.stack([-np.diff(pdf), -np.diff(z_pdf)]) / sigma
        gradient = slopes @ (counts / share)
        information = total * (slopes / share) @ slopes.T
        step = np.linalg.solve(information, gradient)
        mean += float(step[0])
        sigma = max(sigma + float(step[1]), 0.2 * sigma)
        if np.all(np.abs(step) < 1e-10 * sigma):
            break
    variances = np.diag(np.linalg.inv(information))
    return Normal(mean, sigma, math.sqrt(variances[0]), math.sqrt(variances[1]))


def _narrow(edges: F64, held: npt.NDArray[np.int64]) -> Normal:
    """The fit if all counts are in one or two neighbouring places, from the edges alone."""
    if not len(held):
        return Normal(math.nan, math.nan, math.nan, math.nan)
    low = edges[max(int(held[0]) - 1, 0)]
    high = edges[min(int(held[-1]), len(edges) - 1)]
    width = float(high - low)
    return Normal(0.5 * float(low + high), 0.0, width / math.sqrt(12.0), width / math.sqrt(12.0))


def mean_and_error(values: F64) -> tuple[float, float]:
    """Mean and its standard error; NaN for fewer than two values."""
    if len(values) < 2:
        return math.nan, math.nan
    return float(values.mean()), float(values.std(ddof=1)) / math.sqrt(len(values))


def crossing(x: F64, y: F64, level: float) -> float:
    """x at which straight lines through the points first reach `level`; NaN: nowhere."""
    for i in range(len(x) - 1):
        if (y[i] - level) * (y[i + 1] - level) <= 0.0 and y[i] != y[i + 1]:
            return float(x[i] + (x[i + 1] - x[i]) * (level - y[i]) / (y[i + 1] - y[i]))
    return math.nan
