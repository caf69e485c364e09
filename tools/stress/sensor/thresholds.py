"""Thresholds of 0.001 and 10, thresholds that differ, and pixels that are blind for too long."""

from __future__ import annotations

import math

import numpy as np

from evs.tools.stress.step_target import capture_step, capture_sweep, edge_position, messages_of
from evs.tools.stress.stress_case import Measurement, StressCase


def _thresholds(theta: float, exposure_dn: float, short: bool) -> Measurement:
    """Drawn and drawn back, by pixels of this threshold; afterwards nothing is left unexplained."""
    sensor = {"pos_thres": theta, "neg_thres": theta, "exposure_dn": exposure_dn}
    if short:
        sensor |= {"width": 12, "height": 8}
    half = capture_step(lambda tick: edge_position(1, 5, min(tick, 6)), 8, {"sensor": sensor})
    whole = capture_sweep(5 if short else 40, 3, sensor)
    worst = max(half.residual_thresholds(), whole.residual_thresholds())
    limit = 1.0 + half.rounding()
    # the light is again what it was at first
    on, off = whole.counts()
    settled = not len(whole.capture.within((whole.capture.report.ticks - 2) * 1000, 10**9))
    return Measurement(
        worst, limit, "thresholds", messages_of(whole), settled and bool(np.array_equal(on, off))
    )


def _low(short: bool) -> Measurement:
    return _thresholds(0.001, 255.0, short)


def _high(short: bool) -> Measurement:
    return _thresholds(10.0, 1e9, short)


def _spread(short: bool) -> Measurement:
    """Thresholds so unequal that a fifth of them would be below zero."""
    shown = capture_sweep(
        5 if short else 40, 3, {"sigma_thres": 0.6, "pos_thres": 0.5, "neg_thres": 0.5}
    )
    settled = not len(shown.capture.within((shown.capture.report.ticks - 2) * 1000, 10**9))
    named = any("sigma_thres" in line for line in shown.capture.warnings)
    right = settled and named and shown.least_threshold() == np.float32(0.01)
    return Measurement(
        shown.residual_thresholds(), 1.0 + shown.rounding(), "thresholds", messages_of(shown), right
    )


def _blind(short: bool) -> Measurement:
    """Blind for 100 s after each event; beside it a pixel whose blindness ends within the run."""
    length = 5 if short else 40
    for_ever = capture_sweep(length, 3, {"refractory_period_s": 100.0})
    named = any("refractory_period_s" in line for line in for_ever.capture.warnings)
    on, off = for_ever.counts()
    # blind until the plate has moved in: then it sees it move out
    for_long = capture_sweep(length, length, {"refractory_period_s": length * 1e-3})
    again = for_long.counts(for_long.capture.within(length * 1000, 10**9))[0].astype(bool)
    worst = float((on + off).max()) if on.any() or off.any() else math.nan
    return Measurement(
        worst, 1, "event(s) a pixel", messages_of(for_ever), named and bool(again.any())
    )


_PIXEL = (
    "what a pixel has told, its thresholds times its events, is within one threshold of the "
    "light's change"
)

CASES = (
    StressCase(
        "threshold-0.001",
        "sensor",
        "thresholds of 0.001, 5,500 events a pixel from white to black",
        f"{_PIXEL} (and 2^-19, two logarithms' rounding); drawn back, as many ON as OFF",
        _low,
    ),
    StressCase(
        "threshold-10",
        "sensor",
        "thresholds of 10 under a contrast of e^20.7",
        f"{_PIXEL}; drawn back, as many ON as OFF",
        _high,
    ),
    StressCase(
        "sigma-over-theta",
        "sensor",
        "thresholds of 0.5 with a spread of 0.6",
        f"none below 0.01, and {_PIXEL}, its own; a warning says how many are at the floor",
        _spread,
    ),
    StressCase(
        "refractory-beyond-run",
        "sensor",
        "pixels that are blind for 100 s after an event",
        "one event a pixel at most, and a warning; one that is blind for less sees again after it",
        _blind,
    ),
)
