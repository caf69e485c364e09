"""The bandwidth of the pixel, from how its events follow a flank of a blinking lamp.

The events of many pixels count the log light that their comparators see: what is still to come
after a time t is what the photoreceptor still has to do. For a pole it is exp(-w t), and for the
large-signal photoreceptor w (1 - e^(y - x)) it is ln(1 + (e^C - 1) e^(-w t)). When the flank began
does not matter, nor do the first thresholds.
"""

from __future__ import annotations

import math

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.lamp import MOST_BLIND, blind_share
from evs_lab.fit.observed import F64, I64, Observed
from evs_lab.fit.period import flanks_us

KEYS = ("cutoff_hz", "latency_us", "latency_sigma_us")

PART = (0.3, 0.92)
"""share of a flank's events between which their pace counts"""

GROUPS = 5
"""of cycles, whose fits differ by chance"""

FASTEST_US = 20.0
"""time constant below which a lamp or its driver is slower than the pixel"""

ROUGH = 0.015
"""relative error of taking whole events for the log light"""


def fit_bandwidth(
    seen: Observed,
    contrast: float,
    period_s: float,
    base: SensorParameters,
    lux: float | None = None,
    refractory_s: float = 0.0,
) -> list[Estimate]:
    """Fit the bandwidth of the bright side of a blinking lamp.

    Args:
        seen: A lamp that blinks, seen by all pixels.
        contrast: Its bright light over its dark light.
        period_s: Of the lamp, s.
        base: Which photoreceptor it has (`filter`), and how its bandwidth follows the light.
        lux: Illuminance of the sensor while the lamp is bright; None: it is not known.
        refractory_s: The time for which a pixel is blind after an event.
    """
    source = seen.source
    late = [
        cannot(key, source, "when the lamp itself changed is not in the recording")
        for key in KEYS[1:]
    ]
    rises, _ = flanks_us(seen, period_s)
    if len(rises) < 2 * GROUPS:
        return [cannot(KEYS[0], source, f"{len(rises)} rises; record {2 * GROUPS}"), *late]
    blind = blind_share(seen, rises, True, period_s, refractory_s)
    if blind > MOST_BLIND:
        reason = f"the pixels are blind for {100.0 * blind:.0f} % of a flank"
        return [cannot(KEYS[0], source, reason), *late]
    large = base.filter == "large_signal"
    rates = np.array(
        [_rate(seen, rises[k::GROUPS], math.log(contrast), period_s, large) for k in range(GROUPS)]
    )
    known = rates[np.isfinite(rates)]
    if len(known) < GROUPS:
        return [cannot(KEYS[0], source, "a flank has too few events to follow it"), *late]
    rate = float(known.mean())
    if not 0.0 < rate < 1e6 / FASTEST_US:
        reason = f"all events of a flank come within {3.0 * FASTEST_US:g} us"
        return [cannot(KEYS[0], source, reason), *late]
    error = math.hypot(
        float(known.std(ddof=1)) / math.sqrt(GROUPS), ROUGH * rate, 0.5 * blind * rate
    )
    at_hz, at_error = rate / (2.0 * math.pi), error / (2.0 * math.pi)
    found = f"it is {at_hz:.3g} +- {at_error:.2g} Hz in the lamp's bright light"
    if lux is None:
        return [cannot(KEYS[0], source, f"{found}; give its --lux"), *late]
    factor = (base.bright_lux + base.dim_lux) / (lux + base.dim_lux)
    note = f"one pole at {lux:g} lux, {base.filter}; lamp and follower are in it"
    return [Estimate(KEYS[0], factor * at_hz, factor * at_error, source, note=note), *late]


def _rate(seen: Observed, begins: I64, step: float, period_s: float, large: bool) -> float:
    """w of the flanks, 1 / s; infinite: too fast; NaN: too few events."""
    times = seen.events["t"][seen.on].astype(np.int64)
    window = 0.45e6 * period_s
    parts = [
        times[np.searchsorted(times, at - 0.02e6 * period_s) : np.searchsorted(times, at + window)]
        - at
        for at in begins
    ]
    offsets: F64 = np.sort(np.concatenate(parts)) * 1e-6
    # what comes evenly, long after the flank, is leak and noise
    calm = offsets > 0.3 * period_s
    calm_hz = float(calm.sum()) / (0.15 * period_s)
    count = np.arange(1.0, len(offsets) + 1.0) - calm_hz * (offsets + 0.02 * period_s)
    count = count[~calm]
    if len(count) < 200:
        return math.nan
    total = float(count[-max(len(count) // 200, 1) :].mean())
    left = 1.0 - count / total
    inside = (left < 1.0 - PART[0]) & (left > 1.0 - PART[1])
    if inside.sum() < 50:
        return math.nan
    t = offsets[: len(count)][inside]
    to_come = step * left[inside]
    y = np.log(np.expm1(to_come)) if large else np.log(to_come)
    if float(t[-1] - t[0]) < 1e-6:
        return math.inf
    # of events evenly spread over the log light, so that a slow end does not decide alone
    return float(-np.polyfit(t, y, 1, w=np.sqrt(left[inside]))[0])
