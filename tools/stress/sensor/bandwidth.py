"""Photoreceptors of 0.01 Hz and of 1 MHz."""

from __future__ import annotations

import math

import numpy as np

from evs.msgs import Events
from evs.tools.stress.step_target import OPEN, SHUT, capture_step, capture_sweep, messages_of
from evs.tools.stress.stress_case import Measurement, StressCase


def _slow(short: bool) -> Measurement:
    """A pole of 0.01 Hz under a step target that moves in, stays and moves out."""
    length = 20 if short else 200
    theta, cutoff_hz, dim_lux = 0.002, 0.01, 1e6
    sensor = {"pos_thres": theta, "neg_thres": theta, "cutoff_hz": cutoff_hz, "dim_lux": dim_lux}
    sensor |= {"width": 8, "height": 6}
    ticks = 1 + 2 * length
    shown = capture_step(lambda tick: OPEN if tick < 1 else SHUT, ticks, {"sensor": sensor})
    counted = shown.counts()[1]
    # in the dark the pole is at f dim / (bright + dim); the light falls in a line during one tick,
    # so the signal is between those of light that fell at its start and at its end
    z = 2.0 * math.pi * cutoff_hz * dim_lux / (1000.0 + dim_lux) * 1e-3
    change = np.log(255.0) * -np.expm1(-z * np.array([ticks - 2, ticks - 1])) / theta
    off_by = np.abs(counted - change.mean()).max()
    limit = 1.0 + 0.5 * float(np.diff(change)[0])
    named = any("cutoff_hz" in line for line in shown.capture.warnings)
    # ticks of 1 s: after 20 time constants the pixel has settled
    settles = capture_step(
        lambda tick: OPEN if tick < 1 else SHUT,
        100 if short else 400,
        {"sensor": {**sensor, "pos_thres": 0.1, "neg_thres": 0.1},
         "scene": {"tick_us": 1_000_000 * (4 if short else 1)}},
    )  # fmt: skip
    right = named and settles.residual_thresholds() <= 1.0 + settles.rounding()
    return Measurement(float(off_by), limit, "events a pixel", messages_of(shown), right)


def _fast(short: bool) -> Measurement:
    """A pole of 1 MHz beside none at all."""
    length, hz = 5 if short else 40, 1e6
    # no level is just where the light comes to rest: that is reached a tick later
    theta = {"pos_thres": 0.23, "neg_thres": 0.2}
    none, fast = (capture_sweep(length, 3, {**theta, "cutoff_hz": cutoff}) for cutoff in (0.0, hz))
    ours, theirs = (_by_pixel(shown.capture.events) for shown in (fast, none))
    same = np.array_equal(ours[["y", "x", "p"]], theirs[["y", "x", "p"]])
    late_us = float(np.abs(ours["t"] - theirs["t"]).max()) if same else math.nan
    # in the dark the pole is slowest; stamps are whole us
    dark = fast.sensor.dim_lux / (fast.sensor.bright_lux + fast.sensor.dim_lux)
    limit = 1e6 / (2.0 * math.pi * hz * dark) + 1.0
    return Measurement(
        late_us, limit, "us", messages_of(fast), fast.residual_thresholds() <= 1.0 + fast.rounding()
    )


def _by_pixel(events: Events) -> Events:
    return events[np.lexsort((events["t"], events["x"], events["y"]))]


CASES = (
    StressCase(
        "cutoff-0.01-hz",
        "sensor",
        "a photoreceptor with a bandwidth of 0.01 Hz goes dark",
        "events of a pixel: log(255) (1 - e^(-2 pi f t)) / theta, less than 1 away, and half of "
        "those of the tick in which it goes dark; a warning; after 20 time constants all is told",
        _slow,
    ),
    StressCase(
        "cutoff-1-mhz",
        "sensor",
        "a bandwidth of 1 MHz beside none",
        "the same events, late by the pole's 1 / (2 pi f) in the dark, and 1 us: stamps are whole",
        _fast,
    ),
)
