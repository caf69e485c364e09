"""The events of an ideal pixel under known light, written in float64 from the definition.

A pixel fires ON each time its log light is a threshold above its reference, OFF a threshold below,
and the reference moves by that threshold.
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
"""A crossing that is nearer than this share of a threshold may fall on either side: both ends of a
step may be off by the last bit of a float32 of 21, the log light of the sun, which is 2e-6."""

SAME = 1e-6
"""A step that misses whole thresholds by less leads back to an earlier light: it is exactly that
many thresholds, and the last one is reached."""


def log_light(luminance: F64) -> F64:
    """Log light of luminance: ln DN, and linear below e DN, where the two curves touch."""
    dn = WHITE_DN * np.asarray(luminance, np.float64)
    return np.where(dn >= math.e, np.log(np.maximum(dn, math.e)), dn / math.e)


def counts(luminance: F64) -> tuple[F64, Flags]:
    """Count the events that each pixel must fire, and report which pixels are certain.

    Args:
        luminance: (n, ...), one a tick; the first is the reference.

    Returns:
        OFF and ON events in each tick, (n, 2, ...), none in the first; and (...) False where a
        crossing was nearer than NEAR.
    """
    light = log_light(luminance)
    reference = light[0].copy()
    expected = np.zeros((len(light), 2, *light.shape[1:]))
    certain = np.ones(light.shape[1:], np.bool_)
    for tick, now in enumerate(light[1:], 1):
        steps = (now - reference) / THETA
        whole = np.trunc(steps + np.copysign(SAME, steps))
        distance = np.abs(steps - np.rint(steps))
        certain &= (distance > NEAR) | (distance < SAME) | (np.rint(steps) == 0)
        expected[tick, 1], expected[tick, 0] = np.maximum(whole, 0), np.maximum(-whole, 0)
        reference += whole * THETA
    return expected, certain


def count_error(events: Events, luminance: F64, tick_us: int, max_uncertain: float = 0.25) -> float:
    """Count extra and missing events, summed over ticks, polarities and all certain pixels.

    Args:
        events: the events.
        luminance: (ticks + 1, h, w), as for `counts`.
        tick_us: length of a tick.
        max_uncertain: largest share of uncertain pixels.

    Returns:
        The count; inf if more than `max_uncertain` of the picture is uncertain, which leaves little
        to compare.
    """
    expected, certain = counts(luminance)
    found = event_counts(events, len(luminance) - 1, tick_us, certain.shape)
    if certain.mean() < 1.0 - max_uncertain:
        return math.inf
    return float(np.abs(found - expected)[..., certain].sum())


def event_counts(
    events: Events, ticks: int, tick_us: int, shape: tuple[int, int], start_us: int = 0
) -> F64:
    """Count OFF and ON events in each tick, (ticks + 1, 2, h, w); a tick has its end's number."""
    found = np.zeros((ticks + 1, 2, *shape))
    tick = -(-(events["t"] - start_us) // tick_us)
    np.add.at(found, (tick, events["p"], events["y"], events["x"]), 1)
    return found


def residual_thresholds(events: Events, first: F64, last: F64, theta: float = THETA) -> float:
    """Largest change of log light that the events of a pixel do not explain, in thresholds.

    Args:
        events: the events.
        first: (h, w) luminance of the reference.
        last: (h, w) luminance at the end.
        theta: both thresholds, log units.

    Returns:
        The worst pixel's. Below 1 where every pixel's events add up to its change of log light: the
        rest is less than a threshold.
    """
    explained = np.zeros(first.shape)
    np.add.at(explained, (events["y"], events["x"]), np.where(events["p"] != 0, theta, -theta))
    return float(np.abs(log_light(last) - log_light(first) - explained).max() / theta)
