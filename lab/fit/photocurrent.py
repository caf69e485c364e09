"""The photocurrent that gives photon noise the rate of a recording."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.noise_rate import photon_rate_hz
from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.still import Background

KEY = "photocurrent_pa"
THRESHOLDS = ("pos_thres", "neg_thres", "sigma_thres")
STEP = 0.02
"""relative, of the derivatives"""

MODEL_ERROR = 0.1
"""of the predicted rate, relative: lab/tests/characterise/test_characterise_noise.py"""

UNEVEN_ERROR = 2.0
"""of the same, times the difference of the thresholds over their mean: the prediction takes their
mean, and had 47 % less than a sensor with 0.24 and 0.30"""

DECADES = (-3.0, 5.0)
"""photocurrents that are tried, log10 pA"""


def photocurrent(
    still: Background, base: SensorParameters, thresholds: dict[str, Estimate]
) -> Estimate:
    """The photocurrent at `bright_lux` whose photon noise has the rate of a still view.

    The rate follows from the photocurrent, the bandwidth, which is that of the base, and the
    thresholds. Their errors and that of the prediction are in the error.

    Args:
        still: Noise and leak at one light level.
        base: Gives the bandwidth, `dark_lux` and `photon_noise_factor`.
        thresholds: Estimates by key; what is not told is that of the base.
    """
    rate_hz, rate_error = still.noise
    if "shot_noise_rate_hz" in still.reasons:
        return cannot(KEY, still.source, still.reasons["shot_noise_rate_hz"])
    told = {key: thresholds[key] for key in THRESHOLDS if key in thresholds}
    told = {key: one for key, one in told.items() if one.told}
    sensor = _with(base, {key: one.number for key, one in told.items()})
    value = _solved(sensor, still.lux, rate_hz)
    if not math.isfinite(value):
        reason = f"with the bandwidth of the base no photocurrent gives {rate_hz:.2g} Hz of noise"
        return cannot(KEY, still.source, reason)
    uneven = abs(sensor.pos_thres - sensor.neg_thres) / (sensor.pos_thres + sensor.neg_thres)
    model = math.hypot(MODEL_ERROR, 2.0 * UNEVEN_ERROR * uneven)
    relative = [math.hypot(rate_error / rate_hz, model) * _slope(sensor, still.lux, value)]
    for key, one in told.items():
        moved = _with(sensor, {key: one.number + one.error})
        relative.append(math.log(_solved(moved, still.lux, rate_hz) / value))
    error = value * math.hypot(*relative)
    assumed = [key for key in THRESHOLDS if key not in told]
    note = f"with {', '.join(assumed)} of the base" if assumed else "with the base's bandwidth"
    return Estimate(KEY, value, error, still.source, note=note).checked()


def _with(sensor: SensorParameters, values: dict[str, float]) -> SensorParameters:
    changes: dict[str, Any] = dict(values)
    return replace(sensor, **changes)


def _rate_hz(sensor: SensorParameters, lux: float, value: float) -> float:
    return photon_rate_hz(replace(sensor, photocurrent_pa=value), lux)


def _solved(sensor: SensorParameters, lux: float, rate_hz: float) -> float:
    """The photocurrent, pA; NaN: there is none. The rate falls with it."""
    low, high = DECADES
    if not _rate_hz(sensor, lux, 10.0**high) < rate_hz < _rate_hz(sensor, lux, 10.0**low):
        return math.nan
    for _ in range(30):
        middle = 0.5 * (low + high)
        if _rate_hz(sensor, lux, 10.0**middle) > rate_hz:
            low = middle
        else:
            high = middle
    return float(10.0 ** (0.5 * (low + high)))


def _slope(sensor: SensorParameters, lux: float, value: float) -> float:
    """By how much ln photocurrent moves with ln rate."""
    rates = [_rate_hz(sensor, lux, value * factor) for factor in (1.0 - STEP, 1.0 + STEP)]
    return float(2.0 * STEP / abs(np.log(rates[1] / rates[0])))
