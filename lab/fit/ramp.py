"""Thresholds from light that rises and falls evenly: the log light is a known triangle.

Between two ON events of one rise the log light moves by exactly the ON threshold, less what the
reference leaks: theta = slope dt + drift dt, where the drift is the leak rate times the ON
threshold. In a fall the drift works against the light. Whole events and the phase of the reference
do not matter, and neither does the moment at which the ramp begins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.msgs import EvsError
from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.observed import F64, Mask, Observed, medians

KEYS = ("pos_thres", "neg_thres", "sigma_thres", "dead_pixel_fraction")

FEWEST_INTERVALS = 2
"""of a pixel and polarity, in each half of the recording"""

FEWEST_PIXELS = 8
LEAST_SHARE = 0.25
"""of the pixels, which a light that fills the view reaches; something else moved otherwise"""

FAR = 6.0
"""robust standard deviations beyond which a pixel is left out: it is no threshold that it shows"""

ROUGH = 0.02
"""relative error of the mismatch by what the method leaves out: it is 1 to 2 % too small"""

MOST_LEAK = 0.3
"""share of a threshold that leak may bring; such pixels are left out"""


@dataclass(frozen=True)
class PixelLeaks:
    """What a still view tells of the leak of each pixel."""

    rate_hz: F64
    """(pixels,)"""
    error_hz: float = 0.0
    """standard error of their mean"""
    variance_hz2: float = 0.0
    """of what a pixel's own leak may differ by, Hz^2"""


@dataclass(frozen=True)
class RampThresholds:
    """Thresholds of each pixel."""

    on: F64
    """(pixels,) log units; NaN: not measured"""
    off: F64
    halves: F64
    """(4, pixels) ON and OFF thresholds from even and from odd periods"""
    estimates: tuple[Estimate, ...]


def fit_ramp(
    seen: Observed,
    contrast: float,
    period_s: float,
    leaks: PixelLeaks | None = None,
    refractory_s: tuple[float, float] = (0.0, 0.0),
) -> RampThresholds:
    """Fit the thresholds.

    Args:
        seen: Light that rises evenly in its logarithm for half of a period and falls for the other.
        contrast: The brightest light over the darkest, more than 1.
        period_s: Of the light, s.
        leaks: Of the pixels; None: they have none.
        refractory_s: The time for which a pixel is blind after an event, and its standard error.

    Raises:
        EvsError: Contrast or period is senseless.
    """
    check_light(contrast, period_s)
    slope = math.log(contrast) / (0.5 * period_s)
    known = leaks or PixelLeaks(np.zeros(seen.pixels))
    leak_hz = known.rate_hz
    blind_s, blind_error_s = refractory_s
    rises, falls = (_intervals_s(seen, on, period_s) - blind_s for on in (True, False))
    share = leak_hz * rises
    ons = slope * rises / (1.0 - np.where(np.abs(share) < MOST_LEAK, share, np.nan))
    on = ons.mean(axis=0)
    # a pixel whose rises cannot be timed has the mean of the others
    drift = leak_hz * np.where(np.isfinite(on), on, _middle(on))
    offs = (slope - np.where(drift < MOST_LEAK * slope, drift, np.nan)) * falls
    off = offs.mean(axis=0)
    halves = np.concatenate([ons, offs])
    found = (
        _mean(seen, KEYS[0], on, slope, known.error_hz, blind_error_s),
        _mean(seen, KEYS[1], off, slope, known.error_hz, blind_error_s),
        _spread(seen, halves, slope, known.variance_hz2),
        _dead(seen, period_s),
    )
    return RampThresholds(on, off, halves, found)


def check_light(contrast: float, period_s: float) -> None:
    """Check what is known of the light. Raises EvsError."""
    if not contrast > 1.0 or not math.isfinite(contrast):
        raise EvsError(
            f"--contrast is {contrast:g}; give the brightest light over the darkest, more than 1"
        )
    if not period_s > 0.0 or not math.isfinite(period_s):
        raise EvsError(f"--period is {period_s:g}; give the seconds from one rise to the next")


def _intervals_s(seen: Observed, on: bool, period_s: float) -> F64:
    """(2, pixels) median interval inside a rise (or fall), from even and from odd periods."""
    every = seen.intervals
    chosen = (every.before_on == on) & (every.after_on == on)
    chosen &= (every.length_us < 0.5e6 * period_s) & (every.length_us > 0)
    pixel, length = every.pixel[chosen], every.length_us[chosen].astype(np.float64)
    odd = (every.begin_us[chosen] // round(1e6 * period_s)) % 2 == 1
    parts = []
    for half in (~odd, odd):
        middle_us, count = medians(pixel[half], length[half], seen.pixels)
        middle_us[count < FEWEST_INTERVALS] = np.nan
        parts.append(1e-6 * middle_us)
    return np.array(parts)


def _middle(values: F64) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _usual(theta: F64) -> Mask:
    """Pixels whose value lies within FAR robust standard deviations."""
    known = np.isfinite(theta)
    if not known.any():
        return known
    middle = float(np.median(theta[known]))
    sigma = 1.4826 * float(np.median(np.abs(theta[known] - middle)))
    return known & (np.abs(np.nan_to_num(theta) - middle) <= FAR * max(sigma, 1e-3 * middle))


def _mean(
    seen: Observed, key: str, theta: F64, slope: float, leak_error_hz: float, blind_error_s: float
) -> Estimate:
    usual = _usual(theta)
    count = int(usual.sum())
    if count < max(FEWEST_PIXELS, LEAST_SHARE * seen.pixels):
        word = "ON" if key == KEYS[0] else "OFF"
        return cannot(
            key,
            seen.source,
            f"{count} pixels have {2 * FEWEST_INTERVALS} {word} intervals inside a ramp: more "
            "contrast, or more periods",
        )
    mean = float(theta[usual].mean())
    chance = float(theta[usual].std(ddof=1)) / math.sqrt(count)
    # a wrong leak shifts every threshold alike; stamps are whole us
    shift = leak_error_hz * mean * mean / slope
    stamp = slope * 1e-6 / math.sqrt(6.0)
    error = math.hypot(chance, shift, stamp, slope * blind_error_s)
    return Estimate(key, mean, error, seen.source)


def _spread(seen: Observed, halves: F64, slope: float, variance_hz2: float) -> Estimate:
    """The covariance of even and odd periods has the pixels' spread without the noise of either."""
    variances, counts = [], []
    for even, odd in (halves[:2], halves[2:]):
        usual = _usual(even) & _usual(odd)
        if usual.sum() >= max(FEWEST_PIXELS, LEAST_SHARE * seen.pixels):
            variances.append(float(np.cov(even[usual], odd[usual])[0, 1]))
            counts.append(int(usual.sum()))
    if not counts:
        return cannot("sigma_thres", seen.source, "too few pixels have intervals in two periods")
    total = sum(counts)
    variance = sum(v * n for v, n in zip(variances, counts, strict=True)) / total
    # what is not known of a pixel's leak looks like mismatch, alike in both halves
    leaked = variance_hz2 * float(np.nanmedian(halves)) ** 4 / slope**2
    variance -= leaked
    noise = float(np.nanmean(_noise(halves)))
    sigma = math.sqrt(max(variance, 0.0))
    # of a sample covariance: (both variances, and the square of the covariance) / n
    own = math.sqrt(((max(variance, 0.0) + noise) ** 2 + variance**2) / total)
    own = math.hypot(own, 0.5 * leaked, 2.0 * ROUGH * max(variance, 0.0))
    error = own / (2.0 * sigma) if sigma > 0.0 else math.sqrt(max(own, 0.0))
    if sigma < 2.0 * error:
        most = math.sqrt(max(variance, 0.0) + 2.0 * own)
        return Estimate("sigma_thres", 0.0, most, seen.source, note="no spread shows")
    return Estimate("sigma_thres", sigma, error, seen.source)


def _noise(halves: F64) -> F64:
    """Variance of a half's threshold that the other half does not share."""
    found = []
    for even, odd in (halves[:2], halves[2:]):
        usual = _usual(even) & _usual(odd)
        found.append(0.5 * float(np.var((even - odd)[usual])) if usual.any() else math.nan)
    return np.array(found)


def _dead(seen: Observed, period_s: float) -> Estimate:
    """Pixels without any event, where the others have had some in every period."""
    counts = seen.on_counts + seen.off_counts
    periods = seen.seconds / period_s
    if np.median(counts) < 4.0 * max(periods, 1.0):
        return cannot(KEYS[3], seen.source, "most pixels have few events in a period")
    dead = int(np.count_nonzero(counts == 0))
    share = dead / seen.pixels
    error = math.sqrt(max(share * (1.0 - share), 1.0 / seen.pixels / 4.0) / seen.pixels)
    return Estimate(KEYS[3], share, error, seen.source, note="with those that the light missed")
