"""EVT2, EVT3, mono and libcaer against words written out by hand from their formats."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from evs.msgs import Events, EvsError, MessageError, make_events
from evs.msgs.codecs import (
    LONGEST_US,
    PAYLOADS,
    Evt3State,
    PayloadReader,
    PayloadWriter,
    decode_evt2,
    decode_evt3,
    encode_evt2,
    encode_evt3,
)

THREE = make_events([5, 5, 4097], [7, 8, 7], [3, 3, 4], [1, 0, 1])
NONE = make_events([], [], [], [])
LAST = make_events([0, 0], [0, 2047], [0, 2047], [0, 1])


def halves(*words: int) -> bytes:
    return struct.pack(f"<{len(words)}H", *words)


def wholes(*words: int) -> bytes:
    return struct.pack(f"<{len(words)}I", *words)


def rows(events: Events) -> list[tuple[int, ...]]:
    return [tuple(int(event[name]) for name in "txyp") for event in events]


def test_evt3_says_what_is_new_and_begins_with_everything() -> None:
    begin = [0x8000, 0x6005, 0x0003, 0x2807, 0x2008]
    assert encode_evt3(THREE, time_origin_us=0) == halves(*begin, 0x8001, 0x6001, 0x0004, 0x2807)
    # the second packet restates the time and the row
    second = encode_evt3(THREE[2:], time_origin_us=0, after_us=5)
    assert second == halves(0x8000, 0x8001, 0x6001, 0x0004, 0x2807)


def test_evt2_says_what_is_new_and_begins_with_the_time() -> None:
    first, second, third = 1 << 28 | 5 << 22 | 7 << 11 | 3, 5 << 22 | 8 << 11 | 3, 1 << 28 | 1 << 22
    third |= 7 << 11 | 4
    said = encode_evt2(THREE, time_origin_us=0)
    assert said == wholes(0x80000000, first, second, 0x80000040, third)


def test_mono_and_libcaer_are_eight_bytes_an_event() -> None:
    time_base_ns, data = PayloadWriter("mono").payload(THREE)
    assert time_base_ns == 5000
    words = [1 << 63 | 3 << 48 | 7 << 32, 3 << 48 | 8 << 32, 1 << 63 | 4 << 48 | 7 << 32 | 4092000]
    assert data == struct.pack("<3Q", *words)
    time_base_ns, data = PayloadWriter("libcaer").payload(THREE)
    assert time_base_ns == 0
    assert data == wholes(7 << 17 | 3 << 2 | 3, 5, 8 << 17 | 3 << 2 | 1, 5, 7 << 17 | 19, 4097)


def test_time_zero_is_one_second_in_a_stream() -> None:
    said = encode_evt3(LAST)
    assert said[:4] == halves(0x8000 | 1_000_000 >> 12, 0x6000 | 1_000_000 & 0xFFF)
    assert decode_evt3(said, time_origin_us=0)[0]["t"].tolist() == [1_000_000] * 2
    assert decode_evt3(said)[0].tobytes() == LAST.tobytes()
    assert decode_evt2(encode_evt2(LAST))[0].tobytes() == LAST.tobytes()


@pytest.mark.parametrize("first", [0, 2**24 - 1, 2**31, 2**32 + 5])
def test_a_file_tells_absolute_time_whatever_its_first_event(first: int) -> None:
    events = make_events([first], [1], [2], [1])
    for encode, decode in ((encode_evt3, decode_evt3), (encode_evt2, decode_evt2)):
        said = encode(events, after_us=-1_000_000)  # type: ignore[operator]
        assert decode(said)[0].tobytes() == events.tobytes()  # type: ignore[operator]
        # a decoder that counts from the first time it hears counts from zero
        assert said[1] & 0xF0 == 0x80 or said[3] & 0xF0 == 0x80


def test_each_wrap_is_told_as_a_fall_from_the_largest_number_to_zero() -> None:
    events = make_events([10, 2 * 2**24 + 2**23 + 5000], [0, 0], [0, 0], [0, 0])
    words = np.frombuffer(encode_evt3(events, time_origin_us=0), "<u2").tolist()
    told = [word & 0xFFF for word in words if word >> 12 == 8]
    wrap = [0x800, 0xFFF, 0]
    assert told == [0, *wrap, *wrap, 0x800, 0x801]
    events["t"] = [10, 2**34 + 2**33]
    words = np.frombuffer(encode_evt2(events, time_origin_us=0), "<u4").tolist()
    told = [word & 0xFFFFFFF for word in words if word >> 28 == 8]
    assert told == [0, 2**27, 2**28 - 1, 0, 2**27, 2**27]


def test_vectors_are_pixels_to_the_right_of_a_base_that_moves() -> None:
    words = halves(0x8001, 0x6002, 0x0005, 0x3000 | 1 << 11 | 100, 0x4805, 0x5081, 0x4001, 0x2003)
    x = [100, 102, 111, 112, 119, 120, 3]
    expected = [(4098, column, 5, 1) for column in x[:-1]] + [(4098, 3, 5, 0)]
    events, state = decode_evt3(words, time_origin_us=0)
    assert rows(events) == expected
    assert state == Evt3State(high=1, low=2, y=5, base=132, on=1, skipped=0)
    # cut between the base and its vectors
    first, state = decode_evt3(words[:8], time_origin_us=0)
    assert len(first) == 0
    assert rows(decode_evt3(words[8:], state, time_origin_us=0)[0]) == expected


def test_what_is_no_event_is_passed_over() -> None:
    noise = [0xA101, 0xE014, 0x7123, 0xF456, 0x1000, 0x9999, 0xB000, 0xC000, 0xD000]
    words = halves(0x8000, 0x6001, *noise, 0x0002, *noise, 0x2003, *noise)
    events, state = decode_evt3(words + b"\x28", time_origin_us=0)
    assert rows(events) == [(1, 3, 2, 0)]
    assert state.skipped == 0
    words = wholes(0x80000001, 0xA0000000, 0xE0000000, 0xF0000000, 0x20000000, 0x10001802)
    assert rows(decode_evt2(words + b"\0\0\0", time_origin_us=0)[0]) == [(64, 3, 2, 1)]


def test_events_without_a_time_or_a_row_are_counted() -> None:
    words = halves(0x2001, 0x8000, 0x2001, 0x6000, 0x2001, 0x0000, 0x2001, 0x37FF, 0x4FFF)
    events, state = decode_evt3(words, time_origin_us=0)
    assert rows(events) == [(0, 1, 0, 0), (0, 2047, 0, 0)]
    # three untold, and eleven pixels to the right of x = 2047
    assert state.skipped == 3 + 11
    assert events.view("u1").reshape(-1, 16)[:, 13:].max() == 0
    _, evt2 = decode_evt2(wholes(0, 0x80000000, 0), time_origin_us=0)
    assert evt2.skipped == 1


def test_stamps_of_a_camera_that_step_back_a_little_are_no_wrap() -> None:
    words = halves(0x8FFF, 0x6000, 0x0000, 0x2001, 0x8000, 0x2001, 0x8FFF, 0x2001, 0x8FFD, 0x2001)
    t = decode_evt3(words, time_origin_us=0)[0]["t"] >> 12
    assert t.tolist() == [0xFFF, 0x1000, 0x1FFF, 0x1FFD]


def test_libcaer_leaves_out_what_is_marked_invalid_and_counts_a_wrap() -> None:
    full = 2**31 - 1
    data = wholes(7 << 17 | 3 << 2 | 3, full, 8 << 17, full, 8 << 17 | 1, 1)
    assert rows(PayloadReader("libcaer").events(data, 2500)) == [
        (full + 2, 7, 3, 1),
        (2**31 + 3, 8, 0, 0),
    ]


def test_mono_rounds_whole_nanoseconds_down() -> None:
    data = struct.pack("<2Q", 1999, 1 << 63 | 0xFFFF << 32 | 500)
    assert rows(PayloadReader("mono").events(data, 1500)) == [(3, 0, 0, 0), (2, 0x7FFF, 0, 1)]


def test_no_events_are_no_bytes() -> None:
    assert encode_evt2(NONE) == encode_evt3(NONE, after_us=0) == b""
    assert len(decode_evt2(b"")[0]) == len(decode_evt3(b"")[0]) == 0
    for name in PAYLOADS:
        assert PayloadWriter(name).payload(NONE) == (0, b"")
        assert len(PayloadReader(name).events(b"", 0)) == 0


@pytest.mark.parametrize("name", PAYLOADS)
@pytest.mark.parametrize("count", [0, 1, 65_535])
def test_packets_of_any_size_come_back(name: str, count: int) -> None:
    random = np.random.default_rng(count)
    writer, reader = PayloadWriter(name), PayloadReader(name)
    for first in (0, 2**24 - 3, 2**31 - 3, 2**32 - 3):
        t = np.sort(random.integers(first, first + 1000, count))
        x, y = random.integers(0, 2048, count), random.integers(0, 2048, count)
        x[:1], y[:1] = 0, 0
        x[1:2], y[1:2] = 2047, 2047
        events = make_events(t, x, y, random.integers(0, 2, count))
        time_base_ns, data = writer.payload(events)
        assert reader.events(data, time_base_ns).tobytes() == events.tobytes()
    assert reader.skipped == 0


@pytest.mark.parametrize(
    ("events", "says"),
    [
        (make_events([2, 1], [0, 0], [0, 0], [0, 0]), "not sorted"),
        (make_events([0], [2048], [0], [0]), "x of 0 ... 2047"),
        (make_events([0], [0], [2048], [0]), "y of 0 ... 2047"),
        (make_events([0], [-1], [0], [0]), "events have -1"),
        (make_events([-1_000_001], [0], [0], [0]), "no negative time"),
        (make_events([LONGEST_US], [0], [0], [0]), "ends at"),
    ],
)
def test_what_evt_cannot_hold_is_refused(events: Events, says: str) -> None:
    for encode in (encode_evt2, encode_evt3):
        with pytest.raises(MessageError, match=says):
            encode(events)


def test_what_the_others_cannot_hold_is_refused() -> None:
    long = make_events([0, 2**32 // 1000 + 1], [0, 0], [0, 0], [0, 0])
    with pytest.raises(MessageError, match="spans 4294967 us at most"):
        PayloadWriter("mono").payload(long)
    with pytest.raises(MessageError, match="counts from 9 us"):
        PayloadWriter("mono").payload(long, 9)
    long = make_events([5, 2**24 + 5], [0, 0], [0, 0], [0, 0])
    with pytest.raises(MessageError, match="libcaer_cmp packet spans less than 16777216 us"):
        PayloadWriter("libcaer_cmp").payload(long)
    with pytest.raises(MessageError, match="libcaer_cmp counts from 9 us"):
        PayloadWriter("libcaer_cmp").payload(long, 9)
    with pytest.raises(MessageError, match=r"x of 0 \.\.\. 2047 px, events have 2048"):
        PayloadWriter("libcaer_cmp").payload(make_events([0], [2048], [0], [0]))
    with pytest.raises(MessageError, match="2147 s"):
        PayloadWriter("libcaer").payload(make_events([0, 2**31], [0, 0], [0, 0], [0, 0]))
    negative = make_events([-1], [0], [0], [0])
    for name in ("mono", "libcaer", "libcaer_cmp"):
        with pytest.raises(MessageError, match="negative"):
            PayloadWriter(name).payload(negative)
    for after_us in (1, -2_000_000):
        with pytest.raises(MessageError, match="do not follow"):
            encode_evt3(LAST, after_us=after_us)
        with pytest.raises(MessageError, match="do not follow"):
            encode_evt2(LAST, after_us=after_us)
    for kind in (PayloadReader, PayloadWriter):
        with pytest.raises(EvsError, match="no encoding 'evt4'; there is: evt3"):
            kind("evt4")


def test_libcaer_cmp_is_written_as_columns_of_vectors() -> None:
    base = 1_702_669_729_854_452
    told = [(0, 7, 5, 1), (2, 7, 16, 1), (2, 7, 19, 1), (2, 7, 24, 1), (2, 7, 23, 1)]
    told += [(4098, 8, 6, 0), (4098, 8, 7, 0), (4098, 8, 7, 0), (2**24 - 1, 8, 0, 0)]
    events = make_events(*np.array([(base + t, x, y, p) for t, x, y, p in told]).T)
    words = [0x2007, 0x3805, 0x1002, 0x4810, 0x5009, 0x3818, 0x3817]
    words += [0x0001, 0x1002, 0x2008, 0x4000, 0x50C0, 0x3007, 0x0FFF, 0x1FFF, 0x3000]
    assert PayloadWriter("libcaer_cmp").payload(events) == (1000 * base, halves(*words))
    # a packet that continues says where it stands
    assert PayloadWriter("libcaer_cmp").payload(events[1:2], base).data == halves(
        0x0000, 0x1002, 0x2007, 0x3810
    )


def test_libcaer_cmp_is_columns_of_vectors() -> None:
    # from the driver's description: time low 2, x 7, one event; a vector of 0 and 3, one on behind
    words = [0x1002, 0x2007, 0x3805, 0x4810, 0x5009, 0x5001, 0x0001, 0x2008, 0x3006, 0x1000, 0x3007]
    base_us = 1_702_669_729_854_452
    told = [(2, 7, 5, 1), (2, 7, 16, 1), (2, 7, 19, 1), (2, 7, 24, 1), (4098, 8, 6, 0)]
    told += [(4096, 8, 7, 0)]
    events = PayloadReader("libcaer_cmp").events(halves(*words), base_us * 1000 + 999)
    assert rows(events) == [(base_us + t, x, y, p) for t, x, y, p in told]
    # each packet stands alone; half a word is not looked at; what has no x is on no sensor
    reader = PayloadReader("libcaer_cmp")
    assert [len(reader.events(halves(*words) + b"\0", 0)) for _ in range(2)] == [6, 6]
    assert rows(reader.events(halves(0x3805), 0)) == [(0, 0x7FFF, 5, 1)]
    assert len(reader.events(b"", 0)) == 0
