"""Encodings of ROS's event_camera_msgs other than EVT3: mono, libcaer, libcaer_cmp; little-endian.

mono         one u64 an event: bit 63 polarity, 62-48 y, 47-32 x, 31-0 ns since the packet's time
             base
libcaer      8 bytes an event: u32 data with bit 0 valid, bit 1 polarity, bits 16-2 y, bits 31-17 x;
             then an i32, the lower 31 bits of the time, us; the time base holds what is above
             them, ns
libcaer_cmp  words of 16 bits, as libcaer_driver packs a DAVIS's events; bits 15-12 are the type of
             a word, the others its value:

    0 TIME_HIGH    bits 23-12 of the time since the packet's time base, us; 0 when a packet begins
    1 TIME_LOW     bits 11-0 of it; 0 when a packet begins, stays when the upper bits change
    2 ADDR_X       bits 10-0 x of the events that follow
    3 ADDR_Y       bits 10-0 y, bit 11 polarity: one event
    4 VECT_BASE_Y  bits 10-0 y, bit 11 polarity, of the vectors that follow
    5 VECT_8       bit k: an event at base + k; then the base moves on by 8

The time base of libcaer_cmp is the packet's first stamp, ns. Its upper bits do not wrap: a packet
spans less than 16.8 s. Source: libcaer_driver and event_camera_codecs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.codecs.codec import Codec, Payload
from evs.msgs.codecs.counter_wraps import unwrap_counter
from evs.msgs.codecs.limits import EncodingLimits, check_fits
from evs.msgs.event import Events, empty_events
from evs.msgs.header_fields import MessageError
from evs.msgs.trigger import Triggers

MAX_STAMP_NS = 1 << 63
"""Stamps in ns end here: 292 years."""

_MONO_SPAN_US = (1 << 32) // 1000
_COMPRESSED_SPAN_US = 1 << 24
_LIBCAER = np.dtype([("data", "<u4"), ("t", "<u4")])
_LIBCAER_BITS = 31
_HIGH, _LOW, _X, _Y, _BASE, _VECTOR = range(6)
_BITS = 12

NO_X = 0x7FFF
"""x of events before the first ADDR_X, and y of those too far down: on no sensor."""


class Mono(Codec):
    """mono. A packet covers less than 4.29 s."""

    limits = EncodingLimits("mono", 1 << 15, 1 << 15, MAX_STAMP_NS // 1000)
    longest_s = 4.0
    about = "of older drivers"

    def encode(self, events: Events, time_base_us: int | None) -> Payload:
        """Encode a packet; words count from the time base."""
        check_fits(events, self.limits)
        first = int(events["t"][0]) if len(events) else 0
        base = first if time_base_us is None else time_base_us
        if base > first and len(events):
            raise MessageError(f"mono counts from {base} us, events begin at {first} us")
        if len(events) and int(events["t"][-1]) - base > _MONO_SPAN_US:
            raise MessageError(
                f"a mono packet spans {_MONO_SPAN_US} us at most, events reach "
                f"{events['t'][-1] - base}"
            )
        words = ((events["t"] - base) * 1000).astype("<u8")
        words |= events["x"].astype(np.uint64) << 32 | events["y"].astype(np.uint64) << 48
        words |= (events["p"] != 0).astype(np.uint64) << 63
        return Payload(base * 1000, words.tobytes())

    def decode(self, data: Any, time_base_ns: int, triggers: list[Triggers] | None) -> Events:
        """Decode a packet: (n,) events in the order sent; time stamps are rounded down to us.

        An incomplete last word is ignored. x beyond 32,767 is clipped to it.
        """
        del triggers
        words = np.frombuffer(data, "<u8", memoryview(data).nbytes // 8)
        events = empty_events(len(words))
        stamps = (words & 0xFFFFFFFF).astype(np.int64)
        base_us, rest_ns = divmod(time_base_ns, 1000)
        events["t"] = base_us + (stamps + rest_ns) // 1000
        events["x"] = np.minimum(words >> 32 & 0xFFFF, 0x7FFF)
        events["y"] = words >> 48 & 0x7FFF
        events["p"] = words >> 63
        return events


class Libcaer(Codec):
    """libcaer. A packet covers less than 2147 s."""

    limits = EncodingLimits("libcaer", 1 << 15, 1 << 15, MAX_STAMP_NS // 1000)
    about = "for sensors of any size"

    def encode(self, events: Events, time_base_us: int | None) -> Payload:
        """Encode a packet; the time base is the start of the first event's 2147 s."""
        del time_base_us
        check_fits(events, self.limits)
        first = int(events["t"][0]) if len(events) else 0
        words = np.empty(len(events), _LIBCAER)
        words["data"] = events["x"].astype(np.uint32) << 17 | events["y"].astype(np.uint32) << 2 | 1
        words["data"] |= (events["p"] != 0).astype(np.uint32) << 1
        words["t"] = events["t"] & ((1 << _LIBCAER_BITS) - 1)
        if len(events) and (int(events["t"][-1]) - first) >> _LIBCAER_BITS:
            raise MessageError("a libcaer packet spans 2147 s at most: split it")
        return Payload((first >> _LIBCAER_BITS << _LIBCAER_BITS) * 1000, words.tobytes())

    def decode(self, data: Any, time_base_ns: int, triggers: list[Triggers] | None) -> Events:
        """Decode a packet: (n,) events, without those that are marked invalid.

        A stamp that falls by more than half of its range begins the next 2147 s. An incomplete last
        word is ignored.
        """
        del triggers
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


class LibcaerCompressed(Codec):
    """libcaer_cmp. A packet covers less than 16.78 s."""

    limits = EncodingLimits("libcaer_cmp", 1 << 11, 1 << 11, MAX_STAMP_NS // 1000)
    longest_s = 16.0
    about = "libcaer_driver's default"
    most_bytes = 1 << 24

    def encode(self, events: Events, time_base_us: int | None) -> Payload:
        """Encode a packet. With a time base, words restate the time, so that packets can be joined.

        Events of one time, column and polarity whose rows rise within 8 aligned ones share a
        vector, so the order of all events is kept.
        """
        check_fits(events, self.limits)
        first = int(events["t"][0]) if len(events) else 0
        base = first if time_base_us is None else time_base_us
        if not len(events):
            return Payload(base * 1000, b"")
        if base > first:
            raise MessageError(f"libcaer_cmp counts from {base} us, events begin at {first} us")
        if int(events["t"][-1]) - base >= _COMPRESSED_SPAN_US:
            raise MessageError(
                f"a libcaer_cmp packet spans less than {_COMPRESSED_SPAN_US} us, events reach "
                f"{events['t'][-1] - base}"
            )
        y, p = events["y"].astype(np.uint16), (events["p"] != 0).astype(np.uint16)
        # runs of events that one vector can hold
        continues = (y[1:] > y[:-1]) & (y[1:] >> 3 == y[:-1] >> 3) & (p[1:] == p[:-1])
        for name in ("t", "x"):
            continues &= events[name][1:] == events[name][:-1]
        starts = np.flatnonzero(np.concatenate([[True], ~continues]))
        masks = np.bitwise_or.reduceat(np.uint16(1) << (y & 7), starts)
        is_vector = np.diff(starts, append=len(events)) > 1
        since_base = events["t"][starts] - base
        high, low = since_base >> _BITS, since_base & 0xFFF
        x, polarity = events["x"][starts].astype(np.uint16), p[starts] << 11
        row = np.where(is_vector, _BASE << _BITS | y[starts] & 0x7F8, _Y << _BITS | y[starts])
        # what the decoder knows before: nothing of a packet that continues
        known = 0 if time_base_us is None else -1
        words = np.empty((len(starts), 5), "<u2")
        words[:, 0] = _HIGH << _BITS | high
        words[:, 1] = _LOW << _BITS | low
        words[:, 2] = _X << _BITS | x
        words[:, 3] = row | polarity
        words[:, 4] = _VECTOR << _BITS | masks
        is_sent = np.ones(words.shape, np.bool_)
        is_sent[:, 0] = np.diff(high, prepend=known) != 0
        # some decoders look at the time only where its lower bits come
        is_sent[:, 1] = is_sent[:, 0] | (np.diff(low, prepend=known) != 0)
        is_sent[1:, 2] = x[1:] != x[:-1]
        is_sent[:, 4] = is_vector
        return Payload(base * 1000, words[is_sent].tobytes())

    def decode(self, data: Any, time_base_ns: int, triggers: list[Triggers] | None) -> Events:
        """Decode a packet: (n,) events in the order of the words; an odd last byte is ignored."""
        del triggers
        words = np.frombuffer(data, "<u2", memoryview(data).nbytes // 2)
        kinds, values = words >> _BITS, (words & 0xFFF).astype(np.int64)
        high = _last(kinds == _HIGH, unwrap_counter(values[kinds == _HIGH], 0, _BITS), 0)
        low = _last(kinds == _LOW, values[kinds == _LOW], 0)
        x = _last(kinds == _X, values[kinds == _X] & 0x7FF, NO_X)
        # where a vector begins: moved on by the vectors since its base
        is_vector = kinds == _VECTOR
        moved = 8 * np.cumsum(is_vector)
        base_values = values[kinds == _BASE]
        base = _last(kinds == _BASE, (base_values & 0x7FF) - moved[kinds == _BASE], NO_X)
        on = _last(kinds == _BASE, base_values >> 11, 0)
        # one row of pixels a word: a single event fills one of eight
        places = np.flatnonzero(is_vector | (kinds == _Y))
        single, value = kinds[places] == _Y, values[places]
        valid = np.where(single, 1, value & 0xFF).astype(np.uint8)
        bits = np.unpackbits(valid, bitorder="little").reshape(-1, 8).view(np.bool_)
        row, k = np.nonzero(bits)
        first = np.where(single, value & 0x7FF, base[places] + moved[places] - 8)
        events = empty_events(len(row))
        events["t"] = time_base_ns // 1000 + (high << _BITS | low)[places][row]
        events["x"] = x[places][row]
        events["y"] = np.minimum(first[row] + k, NO_X)
        events["p"] = np.where(single, value >> 11, on[places])[row]
        return events


def _last(
    is_update: npt.NDArray[np.bool_], values: npt.NDArray[np.int64], begin: int
) -> npt.NDArray[np.int64]:
    """The value that applies at each word, (n,): that of the last update, `begin` before it."""
    latest: npt.NDArray[np.int64] = np.concatenate([[begin], values])[np.cumsum(is_update)]
    return latest
