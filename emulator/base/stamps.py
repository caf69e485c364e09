"""Stamps: streams whose time does not begin at 0 (scene.start_us), and what is due at a rate.

The emulator counts from 0; what leaves a camera is stamped that much later. So the same events come
out, to the bit, wherever time begins. Frames and IMU samples are due n / rate_hz after zero, in
whole microseconds.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from evs.msgs import EVENT_DTYPE, Events, EvsError, Frame, ImuPacket

MAX_START_US = 2**52
"""In the year 2112 as a Unix time; the sum with the longest run is far inside int64."""


def check_start(start_us: int) -> int:
    """`start_us` itself; EvsError where it is not a valid start time."""
    if not 0 <= start_us <= MAX_START_US:
        raise EvsError(
            f"at scene.start_us: {start_us} is not a start time; give 0 ... {MAX_START_US} us "
            "(a Unix time in microseconds is possible)"
        )
    return start_us


def later_events(events: Events, by_us: int) -> Events:
    """The events `by_us` later; they themselves where that is 0."""
    if not by_us:
        return events
    # as bytes: numpy's copy of fields would leave garbage in the padding
    moved: Events = np.ascontiguousarray(events).view(np.uint8).copy().view(EVENT_DTYPE)
    moved["t"] += by_us
    return moved


def later_frame(frame: Frame, by_us: int) -> Frame:
    """The frame `by_us` later."""
    return replace(
        frame,
        begin_us=frame.begin_us + by_us,
        exposure_begin_us=frame.exposure_begin_us + by_us,
        exposure_end_us=frame.exposure_end_us + by_us,
        end_us=frame.end_us + by_us,
    )


def later_imu(packet: ImuPacket, by_us: int) -> ImuPacket:
    """The samples `by_us` later."""
    moved = np.array(packet.samples)
    moved["t"] += by_us
    return replace(packet, samples=moved)


def stamp_us(index: int, rate_hz: float) -> int:
    """When number `index` is due, us: the nearest whole one, so that no error accumulates."""
    return math.floor(index * 1e6 / rate_hz + 0.5)


def first_from(t_us: int, rate_hz: float) -> int:
    """The lowest number that is due at or after `t_us`."""
    index = math.floor(t_us * rate_hz / 1e6)
    while stamp_us(index, rate_hz) < t_us:
        index += 1
    while stamp_us(index - 1, rate_hz) >= t_us:
        index -= 1
    return index
