"""Thresholds of 0.001 and 10, thresholds that differ, and pixels that are blind for too long."""

from __future__ import annotations

import math

import numpy as np

from evs.tools.stress.extreme import Extreme, Outcome
from evs.tools.stress.step_target import curtain, said_of, sweep, swept


def _thresholds(theta: float, exposure_dn: float, short: bool) -> Outcome:
    """Drawn and drawn back, by pixels of this threshold; afterwards nothing is left untold."""
    sensor = {"pos_thres": theta, "neg_thres": theta, "exposure_dn": exposure_dn}
    if short:
        sensor |= {"width": 12, "height": 8}
    half = curtain(lambda tick: swept(1, 5, min(tick, 6)), 8, {"sensor": sensor})
    whole = sweep(5 if short else 40, 3, sensor)
    worst = max(half.untold(), whole.untold())
    limit = 1.0 + half.rounding()
    # the light is again what it was at first
    on, off = whole.counts()
    settled = not len(whole.film.within((whole.film.report.ticks - 2) * 1000, 10**9))
    return Outcome(
        worst, limit, "thresholds", said_of(whole), settled and bool(np.array_equal(on, off))
    )


def _low(short: bool) -> Outcome:
    return _thresholds(0.001, 255.0, short)


def _high(short: bool) -> Outcome:
    return _thresholds(10.0, 1e9, short)


def _spread(short: bool) -> Outcome:
    """Thresholds so unequal that a fifth of them would be below zero."""
    shown = sweep(5 if short else 40, 3, {"sigma_thres": 0.6, "pos_thres": 0.5, "neg_thres": 0.5})
    settled = not len(shown.film.within((shown.film.report.ticks - 2) * 1000, 10**9))
    named = any("sigma_thres" in line for line in shown.film.warnings)
    right = settled and named and shown.least_threshold() == np.float32(0.01)
    return Outcome(shown.untold(), 1.0 + shown.rounding(), "thresholds", said_of(shown), right)


def _blind(short: bool) -> Outcome:
    """Blind for 100 s after each event; beside it a pixel whose blindness ends within the run."""
    length = 5 if short else 40
    for_ever = sweep(length, 3, {"refractory_period_s": 100.0})
    named = any("refractory_period_s" in line for line in for_ever.film.warnings)
    on, off = for_ever.counts()
    # blind until the curtain has been drawn: then it sees it drawn back
    for_long = sweep(length, length, {"refractory_period_s": length * 1e-3})
    again = for_long.counts(for_long.film.within(length * 1000, 10**9))[0].astype(bool)
    worst = float((on + off).max()) if on.any() or off.any() else math.nan
    return Outcome(worst, 1, "event(s) a pixel", said_of(for_ever), named and bool(again.any()))


_PIXEL = (
    "what a pixel has told, its thresholds times its events, is within one threshold of the "
    "light's change"
)

EXTREMES = (
    Extreme(
        "threshold-0.001",
        "sensor",
        "thresholds of 0.001, 5,500 events a pixel from white to black",
        f"{_PIXEL} (and 2^-19, two logarithms' rounding); drawn back, as many ON as OFF",
        _low,
    ),
    Extreme(
        "threshold-10",
        "sensor",
        "thresholds of 10 under a contrast of e^20.7",
        f"{_PIXEL}; drawn back, as many ON as OFF",
        _high,
    ),
    Extreme(
        "sigma-over-theta",
        "sensor",
        "thresholds of 0.5 with a spread of 0.6",
        f"none below 0.01, and {_PIXEL}, its own; a warning says how many are at the floor",
        _spread,
    ),
    Extreme(
        "refractory-beyond-run",
        "sensor",
        "pixels that are blind for 100 s after an event",
        "one event a pixel at most, and a warning; one that is blind for less sees again after it",
        _blind,
    ),
)
