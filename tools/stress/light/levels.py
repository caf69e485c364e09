"""Light of any strength: none, denormal, fifteen decades in one picture, black to sun."""

from __future__ import annotations

import math

import numpy as np

from evs.tools.stress.grid_target import GridCapture, capture_flashes, capture_grid
from evs.tools.stress.stress_case import Measurement, StressCase

SUN = 1.6e9 * math.pi / 1000.0
"""The sun's disc, 1.6e9 cd/m^2, in units of light: white under 1000 lux is 1."""

USUAL = (0.5, 0.05, 0.9, 0.9, 0.004, 0.5, 1.0)
"""light as it usually is: what a stream has to get right after an extreme"""

DARK_LINE = "sees nothing lit"


def _judged(shown: GridCapture, warnings: int = 0, more: tuple[str, ...] = ()) -> Measurement:
    """Events that are wrong; one more for each warning, or clamp, too many or too few."""
    capture = shown.capture
    unexpected = abs(len(capture.warnings) - warnings) + capture.report.clamps
    messages = (*capture.warnings, f"events {capture.report.events:,}", *more)
    return Measurement(shown.wrong + unexpected, 0, "events", messages, shown.is_explained)


def _no_light(short: bool) -> Measurement:
    shown = capture_flashes([0.0] * (10 if short else 100) + list(USUAL))
    measurement = _judged(shown, warnings=1)
    return measurement if DARK_LINE in "".join(measurement.messages) else Measurement(math.inf, 0)


def _denormal(short: bool) -> Measurement:
    denormal = [1e-40, 0.0, 1e-44, 1e-39, 1e-38, 1.4e-45] * (2 if short else 20)
    return _judged(capture_flashes([*denormal, *USUAL]), warnings=1)


def _decades(short: bool) -> Measurement:
    levels = [10.0**k for k in range(-9, 7)]
    width = len(levels) // 2
    # to the left and back, a plate a tick
    firsts = [width - abs(width - k % (2 * width)) for k in range(17 if short else 161)]
    return _judged(capture_grid(levels, firsts, width))


def _black_to_sun(short: bool) -> Measurement:
    times = 1 if short else 10
    shown = capture_flashes([*[0.0, 0.0, SUN, SUN, 0.0] * times, *USUAL])
    events = shown.capture.events
    sun = events[(events["t"] > 2000) & (events["t"] <= 3000)]
    # all of them inside the tick, in order, and not all at one instant
    crowded = float(len(np.unique(sun["t"])) < 50 or bool((np.diff(events["t"]) < 0).any()))
    measurement = _judged(shown, warnings=1)
    each = len(sun) // shown.light[0].size
    more = (*measurement.messages, f"{each} events of each pixel in the tick of the sun")
    return Measurement(measurement.value + crowded, 0, "events", more, measurement.recovered)


CASES = (
    StressCase(
        "no-light",
        "light",
        "a picture in which nothing is lit; then light as usual",
        "no event without light, then those of ln(light), one by one; one warning says that "
        "nothing is lit",
        _no_light,
    ),
    StressCase(
        "denormal-light",
        "light",
        "light of 1e-45 ... 1e-38, denormal float32, changing every ms; then light as usual",
        "no event: log light is linear below e DN, so they are 1e-36 of a threshold; then those of "
        "ln(light), one by one",
        _denormal,
    ),
    StressCase(
        "fifteen-decades",
        "light",
        "1e-6 ... 1e9 lux (white of 1e-9 ... 1e6) side by side in a picture that moves a decade a "
        "ms, there and back",
        "ln(10) / threshold = 11.5 events a decade: each pixel's count in each tick is that of the "
        "exact logarithm",
        _decades,
    ),
    StressCase(
        "black-to-sun",
        "light",
        "from no light to the sun's disc (1.6e9 cd/m2) on every pixel in one tick, and back",
        "floor(ln(DN) / threshold) = 104 events of each pixel inside the tick, as many back; then "
        "light as usual event by event",
        _black_to_sun,
    ),
)
