"""Events of a window as a picture: one sensor pixel is one picture pixel. Pure functions."""

from __future__ import annotations

import numpy as np

from evs.msgs import Events
from evs.msgs.pictures import U8


def events_between(events: Events, begin_us: int, end_us: int) -> Events:
    """The events with begin_us < t <= end_us, a view of `events`, which are sorted by t."""
    first, last = np.searchsorted(events["t"], (begin_us, end_us), side="right")
    return events[first:last]


def count_polarities(events: Events) -> tuple[int, int]:
    """How many ON and how many OFF events."""
    on = int(np.count_nonzero(events["p"]))
    return on, len(events) - on


def upscale(picture: U8, factor: int) -> U8:
    """Enlarge a picture, (h, w) or (h, w, 3): each pixel becomes factor x factor equal pixels."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def whole_factor(width: int, height: int, wanted_px: int) -> int:
    """The smallest whole factor at which the longer side has at least `wanted_px` pixels."""
    return max(1, -(-wanted_px // max(width, height)))
