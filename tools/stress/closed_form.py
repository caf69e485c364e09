"""The events of an ideal pixel under known light, written in float64 from the definition.

A pixel fires ON each time its log light is a threshold above its reference, OFF a threshold below,
and the reference goes along by that threshold.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from evs.emulator.base.scene import F64
from evs.msgs import Events

Flags = np.ndarray[Any, np.dtype[np.bool_]]

THETA = 0.2
"""both thresholds of the sensor preset `ideal`"""

WHITE_DN = 255.0
"""its exposure: DN of luminance 1"""

NEAR = 3e-5
"""A crossing that is nearer than this share of a threshold may fall on either side: the last bit of
a float32 of 21, the log light of the sun, is 2e-6, which both ends of a step may be off by."""

SAME = 1e-6
"""A step that misses whole thresholds by so little is the way back to light that was there before:
it is as many thresholds exactly, and the threshold itself is reached."""


def log_light(luminance: F64) -> F64:
    """Log light of luminance: ln DN, and linear below e DN, where the two lines touch."""
    dn = WHITE_DN * np.asarray(luminance, np.float64)
    return np.where(dn >= math.e, np.log(np.maximum(dn, math.e)), dn / math.e)


def counts(luminance: F64) -> tuple[F64, Flags]:
    """Events that each pixel must fire, and which pixels are certain.

    In: luminance (n, ...), one a tick; the first is the reference. Out: (n, 2, ...) OFF and ON in
    each tick, none in the first; (...) False where a crossing was nearer than NEAR.
    """
    light = log_light(luminance)
    reference = light[0].copy()
    expected = np.zeros((len(light), 2, *light.shape[1:]))
    certain = np.ones(light.shape[1:], np.bool_)
    for tick, now in enumerate(light[1:], 1):
        steps = (now - reference) / THETA
        whole = np.trunc(steps + np.copysign(SAME, steps))
        beside = np.abs(steps - np.rint(steps))
        certain &= (beside > NEAR) | (beside < SAME) | (np.rint(steps) == 0)
        expected[tick, 1], expected[tick, 0] = np.maximum(whole, 0), np.maximum(-whole, 0)
        reference += whole * THETA
    return expected, certain


def count_error(events: Events, luminance: F64, tick_us: int, max_uncertain: float = 0.25) -> float:
    """Events too many or too few, summed over ticks, polarities and all certain pixels.

    Args:
        events: the events.
        luminance: (ticks + 1, h, w), as of counts. inf if more of the picture than `max_uncertain`
            is uncertain, which leaves little to compare.
        tick_us: length of a tick.
        max_uncertain: largest share of uncertain pixels.
    """
    expected, certain = counts(luminance)
    found = event_counts(events, len(luminance) - 1, tick_us, certain.shape)
    if certain.mean() < 1.0 - max_uncertain:
        return math.inf
    return float(np.abs(found - expected)[..., certain].sum())


def event_counts(
    events: Events, ticks: int, tick_us: int, shape: tuple[int, int], start_us: int = 0
) -> F64:
    """(ticks + 1, 2, h, w) OFF and ON events in each tick, whose number is its end's."""
    found = np.zeros((ticks + 1, 2, *shape))
    tick = -(-(events["t"] - start_us) // tick_us)
    np.add.at(found, (tick, events["p"], events["y"], events["x"]), 1)
    return found


def residual_thresholds(events: Events, first: F64, last: F64, theta: float = THETA) -> float:
    """Largest change of log light that the events of a pixel do not explain, in thresholds.

    In: luminance (h, w) of the reference and of the end. Below 1 where every pixel's events add up
    to its change of log light: what is left is not yet a threshold. Out: the worst pixel's.
    """
    explained = np.zeros(first.shape)
    np.add.at(explained, (events["y"], events["x"]), np.where(events["p"] != 0, theta, -theta))
    return float(np.abs(log_light(last) - log_light(first) - explained).max() / theta)
