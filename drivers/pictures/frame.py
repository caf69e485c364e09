"""Events of a window as a picture: one sensor pixel is one picture pixel. Pure functions."""

from __future__ import annotations

import numpy as np

from evs.drivers.pictures.colours import OFF_RGB, ON_RGB, PAPER, U8
from evs.msgs import Events, EvsError


def events_between(events: Events, begin_us: int, end_us: int) -> Events:
    """The events with begin_us < t <= end_us, a view of `events`, which are sorted by t."""
    first, last = np.searchsorted(events["t"], (begin_us, end_us), side="right")
    return events[first:last]


def count_polarities(events: Events) -> tuple[int, int]:
    """How many ON and how many OFF events."""
    on = int(np.count_nonzero(events["p"]))
    return on, len(events) - on


def event_frame(events: Events, width: int, height: int, background: U8 | None = None) -> U8:
    """Draw events in colour over a grey picture.

    Args:
        events: (n,) EVENT_DTYPE; a pixel with several events has the colour of the last one.
        width: Sensor width, px.
        height: Sensor height, px.
        background: (height, width) grey; None: paper white.

    Returns:
        (height, width, 3).

    Raises:
        EvsError: An event lies outside the sensor, or the background has another size.
    """
    if background is None:
        grey = np.full((height, width), PAPER, np.uint8)
    else:
        grey = background
    if grey.shape != (height, width):
        size = " x ".join(str(n) for n in grey.shape[::-1])
        raise EvsError(f"the background is {size}, not {width} x {height}: give the sensor's size")
    frame = np.repeat(grey[:, :, np.newaxis], 3, axis=2)
    x, y = events["x"], events["y"]
    outside = (x < 0) | (x >= width) | (y < 0) | (y >= height)
    if outside.any():
        first = events[np.argmax(outside)]
        raise EvsError(
            f"an event at ({first['x']}, {first['y']}) is outside the sensor of "
            f"{width} x {height}: the file's resolution is wrong"
        )
    # with repeated indices numpy keeps the last assignment: the last event wins
    colours = np.array([OFF_RGB, ON_RGB], np.uint8)
    frame[y, x] = colours[(events["p"] != 0).astype(np.intp)]
    return frame


def upscale(picture: U8, factor: int) -> U8:
    """Enlarge a picture, (h, w) or (h, w, 3): each pixel becomes factor x factor equal pixels."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def whole_factor(width: int, height: int, wanted_px: int) -> int:
    """The smallest whole factor at which the longer side has at least `wanted_px` pixels."""
    return max(1, -(-wanted_px // max(width, height)))
