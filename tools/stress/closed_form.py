"""What an ideal pixel must say of known light: written anew, in float64, from its definition.

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
    """Events that each pixel owes, and which pixels are in no doubt.

    In: luminance (n, ...), one a tick; the first is the reference. Out: (n, 2, ...) OFF and ON in
    each tick, none in the first; (...) False where a crossing was nearer than NEAR.
    """
    light = log_light(luminance)
    reference = light[0].copy()
    owed = np.zeros((len(light), 2, *light.shape[1:]))
    sure = np.ones(light.shape[1:], np.bool_)
    for tick, now in enumerate(light[1:], 1):
        steps = (now - reference) / THETA
        whole = np.trunc(steps + np.copysign(SAME, steps))
        beside = np.abs(steps - np.rint(steps))
        sure &= (beside > NEAR) | (beside < SAME) | (np.rint(steps) == 0)
        owed[tick, 1], owed[tick, 0] = np.maximum(whole, 0), np.maximum(-whole, 0)
        reference += whole * THETA
    return owed, sure


def miscounted(events: Events, luminance: F64, tick_us: int, most_unsure: float = 0.25) -> float:
    """Events too many or too few in a pixel, tick and polarity, over all pixels without a doubt.

    In: luminance (ticks + 1, h, w), as of counts. inf where more of the picture than `most_unsure`
    is in doubt: there is little to be compared then.
    """
    owed, sure = counts(luminance)
    found = seen_counts(events, len(luminance) - 1, tick_us, sure.shape)
    if sure.mean() < 1.0 - most_unsure:
        return math.inf
    return float(np.abs(found - owed)[..., sure].sum())


def seen_counts(
    events: Events, ticks: int, tick_us: int, shape: tuple[int, int], start_us: int = 0
) -> F64:
    """(ticks + 1, 2, h, w) OFF and ON events in each tick, whose number is its end's."""
    found = np.zeros((ticks + 1, 2, *shape))
    tick = -(-(events["t"] - start_us) // tick_us)
    np.add.at(found, (tick, events["p"], events["y"], events["x"]), 1)
    return found


def untold(events: Events, first: F64, last: F64, theta: float = THETA) -> float:
    """How far the events of a stream are from telling what became of the light, thresholds.

    In: luminance (h, w) of the reference and of the end. Below 1 where every pixel's events add up
    to its change of log light: what is left is not yet a threshold. Out: the worst pixel's.
    """
    told = np.zeros(first.shape)
    np.add.at(told, (events["y"], events["x"]), np.where(events["p"] != 0, theta, -theta))
    return float(np.abs(log_light(last) - log_light(first) - told).max() / theta)
