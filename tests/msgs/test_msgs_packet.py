"""EventPacket on the wire: what goes in comes out, and everything else is refused by name."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from evs.msgs import (
    EVENT_DTYPE,
    EventPacket,
    MessageError,
    decode,
    empty_events,
    encode,
    make_events,
)
from evs.msgs.packet import MAX_HEADER_BYTES, packb, unpackb

GOOD: dict[str, Any] = {
    "seq": 3,
    "time_base": 3000,
    "time_end": 4000,
    "encoding": "evs16",
    "is_bigendian": False,
    "width": 346,
    "height": 260,
    "camera": "track",
}


def packet(**changes: Any) -> EventPacket:
    events = make_events([3001, 3500, 4000], [0, 345, 10], [259, 0, 20], [1, 0, 1])
    whole = EventPacket(3, 3000, 4000, 346, 260, events, "track")
    return replace(whole, **changes)


def same(one: EventPacket, other: EventPacket) -> bool:
    heads = [replace(each, events=empty_events()) for each in (one, other)]
    plain = [(h.seq, h.time_base_us, h.time_end_us, h.width, h.height, h.camera) for h in heads]
    return plain[0] == plain[1] and one.events.tobytes() == other.events.tobytes()


def test_header_bytes_are_as_written_down() -> None:
    header, frame = encode(packet())
    assert msgpack.unpackb(header) == GOOD
    assert list(msgpack.unpackb(header)) == list(GOOD)
    assert header.hex() == (
        "88a373657103a974696d655f62617365cd0bb8a874696d655f656e64cd0fa0a8656e636f64696e67a565767331"
        "36ac69735f626967656e6469616ec2a57769647468cd015aa6686569676874cd0104a663616d657261a57472"
        "61636b"
    )
    assert frame.nbytes == 3 * 16


@pytest.mark.parametrize(
    "sent",
    [
        packet(),
        packet(events=empty_events()),
        packet(camera="Käm era/左", seq=2**63 - 1),
        packet(width=32767, height=32767),
        EventPacket(0, -(2**62), 2**63 - 1, 346, 260, make_events([2**63 - 1], [1], [1], [0])),
    ],
)
def test_round_trip(sent: EventPacket) -> None:
    header, frame = encode(sent)
    assert same(decode(header, bytes(frame)), sent)
    assert same(decode(header, bytearray(frame)), sent)
    assert same(decode(header, frame), sent)


def test_frame_is_not_copied_and_a_stride_is() -> None:
    sent = packet()
    _, frame = encode(sent)
    assert np.shares_memory(np.frombuffer(frame, np.uint8), sent.events)
    thin = packet(events=np.repeat(sent.events, 2)[::2])
    assert not thin.events.flags.c_contiguous
    assert same(decode(*encode(thin)), sent)


def test_numpy_numbers_are_numbers() -> None:
    sent = packet(seq=np.int64(3), time_end_us=np.int64(4000), width=np.int16(346))
    assert same(decode(*encode(sent)), packet())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seq": -1}, "seq"),
        ({"seq": 2**63}, "seq"),
        ({"seq": 1.0}, "seq"),
        ({"seq": True}, "seq"),
        ({"seq": None}, "seq"),
        ({"seq": "3"}, "seq"),
        ({"time_base": 4001}, "ends at 4000 us, before it begins"),
        ({"time_end": 2**63}, "time_end"),
        ({"time_base": -(2**63)}, "time_base"),
        ({"width": 0}, "width"),
        ({"width": 32768}, "width"),
        ({"height": -260}, "height"),
        ({"encoding": "evt3"}, "encoding"),
        ({"encoding": b"evs16"}, "encoding"),
        ({"encoding": ["evs16"] * 1000}, "encoding"),
        ({"is_bigendian": True}, "little-endian"),
        ({"is_bigendian": 0}, "little-endian"),
        ({"camera": ""}, "camera"),
        ({"camera": 7}, "camera"),
        ({"camera": "a\nb"}, "camera"),
        ({"camera": "\x1b[2J"}, "camera"),
        ({"camera": "x" * 256}, "camera"),
    ],
)
def test_bad_values_are_refused(changes: dict[str, Any], words: str) -> None:
    header = msgpack.packb({**GOOD, **changes})
    with pytest.raises(MessageError, match=words) as caught:
        decode(header, b"")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seq", -1),
        ("seq", 10**40),
        ("seq", 3.0),
        ("seq", np.float64(3)),
        ("seq", np.uint64(2**63)),
        ("time_base_us", 4001),
        ("time_end_us", 2**64),
        ("width", np.bool_(True)),
        ("height", None),
        ("camera", None),
        ("camera", "a\tb"),
        ("camera", "\ud800"),
    ],
)
def test_a_packet_that_would_be_refused_is_not_sent(name: str, value: Any) -> None:
    with pytest.raises(MessageError):
        encode(packet(**{name: value}))


@pytest.mark.parametrize("name", sorted(GOOD))
def test_every_field_is_needed(name: str) -> None:
    with pytest.raises(MessageError):
        decode(msgpack.packb({key: GOOD[key] for key in GOOD if key != name}), b"")


def test_unknown_fields_are_for_later_versions() -> None:
    header = msgpack.packb({**GOOD, "gain": 2})
    assert same(decode(header, b""), packet(events=empty_events()))


@pytest.mark.parametrize(
    "header",
    [
        b"",
        b"\xc1",
        b"\x80",
        msgpack.packb([1, 2]),
        msgpack.packb(5),
        msgpack.packb(GOOD)[:-1],
        msgpack.packb(GOOD) + b"\x00",
        b"\x81\xa1\xff\x00",
        b"\x81\x93\x01\x02\x03\x00",
        b"\xdf\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff",
        b"\xc7\x03\xff\x00\x00\x00",
        b"\x91" * 60_000,
        b"\x00" * (MAX_HEADER_BYTES + 1),
    ],
)
def test_torn_and_hostile_headers_are_refused(header: bytes) -> None:
    with pytest.raises(MessageError) as caught:
        decode(header, b"")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("size", [1, 15, 17, 33])
def test_half_events_are_refused(size: int) -> None:
    with pytest.raises(MessageError, match="not whole events"):
        decode(msgpack.packb(GOOD), bytes(size))


@pytest.mark.parametrize(
    ("events", "words"),
    [
        (make_events([3500, 3499], [1, 1], [1, 1], [1, 1]), "not sorted"),
        (make_events([3000], [1], [1], [1]), "outside the packet"),
        (make_events([4001], [1], [1], [1]), "outside the packet"),
        (make_events([3500], [346], [1], [1]), "346x260"),
        (make_events([3500], [-1], [1], [1]), "346x260"),
        (make_events([3500], [1], [260], [1]), "346x260"),
        (make_events([3500], [1], [-1], [1]), "346x260"),
        (make_events([3500], [1], [1], [2]), "polarity"),
        (make_events([3500], [1], [1], [-1]), "polarity"),
    ],
)
def test_events_keep_the_packets_promises_at_both_ends(events: Any, words: str) -> None:
    with pytest.raises(MessageError, match=words):
        decode(msgpack.packb(GOOD), events.tobytes())
    with pytest.raises(MessageError, match=words):
        encode(packet(events=events))


@pytest.mark.parametrize("place", [13, 14, 15])
def test_dirty_padding_is_cleaned_before_it_leaves_and_refused_when_it_comes(place: int) -> None:
    whole = packet()
    raw = bytearray(whole.events.tobytes())
    raw[16 + place] = 0xAB
    with pytest.raises(MessageError, match="padding"):
        decode(msgpack.packb(GOOD), raw)
    dirty = np.frombuffer(raw, EVENT_DTYPE)
    assert encode(packet(events=dirty))[1] == whole.events.tobytes()


def test_what_numpy_makes_of_events_is_sent_as_events() -> None:
    whole = packet()
    dirt = np.full(48, 0xAB, np.uint8)
    del dirt
    several = [
        whole.events.copy(),
        whole.events[whole.events["t"] > 0],
        np.concatenate([whole.events[:1], whole.events[1:]]),
        np.sort(whole.events, order="t"),
    ]
    for events in several:
        assert same(decode(*encode(packet(events=events))), whole)


@pytest.mark.parametrize(
    "events",
    [
        np.zeros(3, [("t", "<i8"), ("x", "<i4"), ("y", "<i2"), ("p", "i1")]),
        np.zeros(3, [("t", "<i8"), ("y", "<i2"), ("x", "<i2"), ("p", "i1")]),
        np.zeros(3, [("t", "<i8"), ("x", "<i2"), ("y", "<i2")]),
        np.zeros(3, np.int64),
        np.zeros((2, 2), packet().events.dtype),
        np.zeros(16, np.uint8),
        [(3500, 1, 1, 1)],
        None,
    ],
)
def test_only_event_arrays_are_encoded(events: Any) -> None:
    with pytest.raises(MessageError, match="EVENT_DTYPE"):
        encode(packet(events=events))


@pytest.mark.parametrize("value", [object(), {1}, 2**64, "x" * (MAX_HEADER_BYTES + 1), 1 + 2j])
def test_what_cannot_be_packed_is_said(value: object) -> None:
    with pytest.raises(MessageError):
        packb({"value": value})


def test_a_map_comes_back() -> None:
    assert unpackb(packb({"a": [1, "b", None, 1.5]})) == {"a": [1, "b", None, 1.5]}


def test_the_bytes_in_the_description_are_the_real_ones() -> None:
    text = (Path(__file__).parents[2] / "docs/reference/wire.md").read_text(encoding="utf-8")
    # hex of the indented example lines, up to the column of words
    lines = [line.strip() for line in text.splitlines() if re.match(r"    [0-9a-f]{2} ", line)]
    shown = [re.match(r"(?:[0-9a-f]{2}(?: +|$))+", line).group() for line in lines]  # type: ignore[union-attr]
    event, *header = [bytes.fromhex(line) for line in shown]
    assert event == make_events([3500], [10], [20], [1]).tobytes()
    assert b"".join(header) == encode(packet())[0]
    assert f"{len(encode(packet())[0])} bytes" in text
