"""Encodings of 8 bytes an event that ROS knows: `mono` and `libcaer`, little-endian.

mono     one u64: bit 63 polarity, 62-48 y, 47-32 x, 31-0 ns since the packet's time base
libcaer  u32 data: bit 0 valid, bit 1 polarity, bits 16-2 y, bits 31-17 x; then an i32: the
         lower 31 bits of the time, us; the time base holds what is above them, ns
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from evs.msgs.codecs.limits import EncodingLimits, check_fits
from evs.msgs.event import Events, empty_events
from evs.msgs.header_fields import MessageError

MAX_STAMP_NS = 1 << 63
"""Stamps in ns end here: 292 years."""

MONO = EncodingLimits("mono", 1 << 15, 1 << 15, MAX_STAMP_NS // 1000)
LIBCAER = EncodingLimits("libcaer", 1 << 15, 1 << 15, MAX_STAMP_NS // 1000)

MONO_SPAN_US = (1 << 32) // 1000
"""A mono packet covers less than 4.29 s."""

_LIBCAER = np.dtype([("data", "<u4"), ("t", "<u4")])
_LIBCAER_BITS = 31


class Payload(NamedTuple):
    """What an event_camera_msgs/EventPacket carries."""

    time_base_ns: int
    """its time_base; what it means is the encoding's"""
    data: bytes
    """its events"""


def encode_mono(events: Events, time_base_us: int | None = None) -> Payload:
    """Encode a packet.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t.
        time_base_us: Time base, us, not after the first event; None: the first event's time.

    Raises:
        MessageError: The events do not fit, mostly because they span more than 4.29 s.
    """
    check_fits(events, MONO)
    first = int(events["t"][0]) if len(events) else 0
    base = first if time_base_us is None else time_base_us
    if base > first and len(events):
        raise MessageError(f"mono counts from {base} us, events begin at {first} us")
    if len(events) and int(events["t"][-1]) - base > MONO_SPAN_US:
        raise MessageError(
            f"a mono packet spans {MONO_SPAN_US} us at most, events reach {events['t'][-1] - base}"
        )
    words = ((events["t"] - base) * 1000).astype("<u8")
    words |= events["x"].astype(np.uint64) << 32 | events["y"].astype(np.uint64) << 48
    words |= (events["p"] != 0).astype(np.uint64) << 63
    return Payload(base * 1000, words.tobytes())


def decode_mono(data: Any, time_base_ns: int) -> Events:
    """Decode a packet: (n,) events in the order sent; time stamps are rounded down to us.

    An incomplete last word is ignored. x beyond 32,767 is clipped to it.
    """
    words = np.frombuffer(data, "<u8", memoryview(data).nbytes // 8)
    events = empty_events(len(words))
    stamps = (words & 0xFFFFFFFF).astype(np.int64)
    base_us, rest_ns = divmod(time_base_ns, 1000)
    events["t"] = base_us + (stamps + rest_ns) // 1000
    events["x"] = np.minimum(words >> 32 & 0xFFFF, 0x7FFF)
    events["y"] = words >> 48 & 0x7FFF
    events["p"] = words >> 63
    return events


def encode_libcaer(events: Events) -> Payload:
    """Encode a packet of events, (n,) sorted by t. MessageError: they do not fit."""
    check_fits(events, LIBCAER)
    first = int(events["t"][0]) if len(events) else 0
    words = np.empty(len(events), _LIBCAER)
    words["data"] = events["x"].astype(np.uint32) << 17 | events["y"].astype(np.uint32) << 2 | 1
    words["data"] |= (events["p"] != 0).astype(np.uint32) << 1
    words["t"] = events["t"] & ((1 << _LIBCAER_BITS) - 1)
    if len(events) and (int(events["t"][-1]) - first) >> _LIBCAER_BITS:
        raise MessageError("a libcaer packet spans 2147 s at most: split it")
    return Payload((first >> _LIBCAER_BITS << _LIBCAER_BITS) * 1000, words.tobytes())


def decode_libcaer(data: Any, time_base_ns: int) -> Events:
    """Decode a packet: (n,) events, without those that are marked invalid.

    A stamp that falls by more than half of its range begins the next 2147 s. An incomplete last
    word is ignored.
    """
    words = np.frombuffer(data, _LIBCAER, memoryview(data).nbytes // 8)
    low = (words["t"] & ((1 << _LIBCAER_BITS) - 1)).astype(np.int64)
    wraps = np.cumsum(low[:-1] - low[1:] > 1 << (_LIBCAER_BITS - 1))
    low[1:] += wraps << _LIBCAER_BITS
    valid = (words["data"] & 1).astype(bool)
    data_words = words["data"][valid]
    events = empty_events(len(data_words))
    base_us, rest_ns = divmod(time_base_ns, 1000)
    events["t"] = base_us + (low[valid] * 1000 + rest_ns) // 1000
    events["x"] = data_words >> 17
    events["y"] = data_words >> 2 & 0x7FFF
    events["p"] = data_words >> 1 & 1
    return events
