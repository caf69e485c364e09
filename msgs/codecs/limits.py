"""What an encoding can hold: how far out a pixel and how late a stamp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.msgs.event import Events
from evs.msgs.header_fields import MessageError

TIME_ORIGIN_US = 1_000_000
"""Time stamp of simulated time zero in EVT3 streams on ROS and in bags: some decoders treat the
stamp 0 as "no time yet" and lose its events. RAW files count from 0."""

LONGEST_US = 1 << 44
"""Time stamps of EVT2 and EVT3 streams lie below it (203 days): every wrap of their counters has to
be encoded, and more of them are a mistake."""

LAST_ROS_US = 2**31 * 1_000_000 - 1
"""ROS's time has int32 seconds: it ends in January 2038 of Unix time."""

MAX_SIDE_EVT_PX = 1 << 11
"""EVT2 and EVT3 have 11 bits for x and for y."""


@dataclass(frozen=True)
class EncodingLimits:
    """What an encoding has bits for."""

    name: str
    width: int
    """x has to be smaller, px"""
    height: int
    """y has to be smaller, px"""
    end_us: int
    """stamps have to be smaller, us; they are never negative"""


def check_fits(events: Events, limits: EncodingLimits, shift_us: int = 0) -> None:
    """MessageError unless the events, (n,), are sorted and fit the encoding, `shift_us` later."""
    if not len(events):
        return
    stamps = events["t"]
    if (stamps[1:] < stamps[:-1]).any():
        raise MessageError(f"events are not sorted by t, which {limits.name} asks for: sort them")
    first, last = int(stamps[0]) + shift_us, int(stamps[-1]) + shift_us
    if first < 0:
        raise MessageError(f"{limits.name} has no negative time, events begin at {first} us")
    if last >= limits.end_us:
        raise MessageError(f"{limits.name} ends at {limits.end_us} us, events at {last} us")
    for axis, side in (("x", limits.width), ("y", limits.height)):
        # read as unsigned, a negative coordinate is too large as well
        if int(events[axis].view(np.uint16).max()) >= side:
            low, high = int(events[axis].min()), int(events[axis].max())
            raise MessageError(
                f"{limits.name} holds {axis} of 0 ... {side - 1} px, events have {low} ... {high}"
            )


def decoder_time_us(events: Events, time_origin_us: int, after_us: int | None) -> int:
    """The time that a decoder has reached before some events.

    Args:
        events: (n,) EVENT_DTYPE with n > 0.
        time_origin_us: Time stamp of the stream's time zero, us.
        after_us: The last time that was encoded, us; None: nothing was.

    Returns:
        The time stamp, us.

    Raises:
        MessageError: It is later than the first event.
    """
    first = int(events["t"][0])
    known = (first if after_us is None else after_us) + time_origin_us
    if not 0 <= known <= first + time_origin_us:
        raise MessageError(f"events at {first} us do not follow {after_us} us")
    return known
