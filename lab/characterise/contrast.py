"""The S-curve: the share of the pixels that respond to a step of contrast; all thresholds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs_lab.characterise.bench import F64, Bench, Mask
from evs_lab.characterise.fit import Normal, fit_normal
from evs_lab.characterise.quantity import Quantity
from evs_lab.characterise.settle import Settled, least_contrast, settle

DAYLIGHT_LUX = 10_000.0
"""the pixel is fast there, and dark current negligible"""

STEPS = 29
SIGMAS = 3.5
"""how far the contrasts of the curve reach to both sides of its middle"""


@dataclass(frozen=True)
class SCurve:
    """The S-curve of one polarity."""

    contrast: F64
    """(n,) steps that were shown, ln of the ratio of light"""
    share: F64
    """(n,) share of the pixels that responded"""
    fit: Normal
    """of the thresholds, log units"""
    thresholds: F64
    """(h, w) threshold of each pixel, log units; NaN: not measured"""


@dataclass(frozen=True)
class Thresholds:
    """Both polarities of a sensor in daylight."""

    on: SCurve
    off: SCurve
    dead_share: float
    """share of the pixels that never respond"""

    @property
    def unevenness(self) -> float:
        """Standard deviation over mean of the OFF thresholds; 0: not measured."""
        fit = self.off.fit
        return fit.sigma / fit.mean if fit.mean > 0.0 else 0.0

    def results(self, sensor: SensorParameters) -> list[Quantity]:
        """Mean and spread of both polarities, and the share of dead pixels."""
        found = []
        for name, curve, mean in (
            ("ON threshold", self.on, sensor.pos_thres),
            ("OFF threshold", self.off, sensor.neg_thres),
        ):
            fit = curve.fit
            note = "no pixel answers" if math.isnan(fit.mean) else ""
            found += [
                Quantity(name, "log", fit.mean, fit.mean_error, mean, DAYLIGHT_LUX, note),
                Quantity(
                    f"{name}, sigma over pixels",
                    "log",
                    fit.sigma,
                    fit.sigma_error,
                    sensor.sigma_thres,
                    DAYLIGHT_LUX,
                    note,
                ),
            ]
        dead = sensor.dead_pixel_fraction
        error = math.sqrt(
            max(self.dead_share * (1 - self.dead_share), 0.0) / self.on.thresholds.size
        )
        found.append(Quantity("dead pixels", "", self.dead_share, error, dead, DAYLIGHT_LUX))
        return found

    def weber_results(self, sensor: SensorParameters) -> list[Quantity]:
        """The mean thresholds as Weber contrasts, (L_max - L_min) / L_min, in percent."""
        found = []
        for name, curve, mean in (
            ("ON threshold, Weber contrast", self.on, sensor.pos_thres),
            ("OFF threshold, Weber contrast", self.off, sensor.neg_thres),
        ):
            measured, error = curve.fit.mean, curve.fit.mean_error
            note = "no pixel answers" if math.isnan(measured) else ""
            percent, promised = 100.0 * math.expm1(measured), 100.0 * math.expm1(mean)
            percent_error = 100.0 * math.exp(measured) * error
            found.append(Quantity(name, "%", percent, percent_error, promised, DAYLIGHT_LUX, note))
        return found


def measure_thresholds(bench: Bench) -> Thresholds:
    """Measure the S-curves of both polarities, from rest in daylight."""
    settled = settle(bench, DAYLIGHT_LUX)
    quiet = settled.quiet()
    dead = float(np.mean(settled.dead))
    return Thresholds(_curve(settled, quiet, True), _curve(settled, quiet, False), dead)


def _curve(settled: Settled, quiet: Mask, on: bool) -> SCurve:
    sensor = settled.exposure.bench.sensor
    sign = 1.0 if on else -1.0

    def answers(contrast: F64) -> Mask:
        return settled.step(settled.lux * np.exp(sign * contrast), on)

    own = least_contrast(answers, settled.exposure.bench.pixels)
    own[~quiet] = np.nan
    thresholds = own.reshape(sensor.height, sensor.width)
    tested = own[np.isfinite(own)]
    if not len(tested):
        nothing = Normal(math.nan, math.nan, math.nan, math.nan)
        return SCurve(np.zeros(0), np.zeros(0), nothing, thresholds)

    # steps that all pixels see together, around their own thresholds
    low, middle, high = np.quantile(tested, (0.16, 0.5, 0.84))
    reach = SIGMAS * max(0.5 * (high - low), 1e-4 * middle)
    contrast = np.linspace(max(middle - reach, 0.05 * middle), middle + reach, STEPS)
    counted = np.isfinite(own)
    counts = [
        np.count_nonzero(settled.step(settled.lux * math.exp(sign * step), on) & counted)
        for step in contrast
    ]
    reached = np.maximum.accumulate(np.array([0, *counts, len(tested)], np.float64))
    return SCurve(contrast, reached[1:-1] / len(tested), fit_normal(contrast, np.diff(reached)),
                  thresholds)  # fmt: skip
