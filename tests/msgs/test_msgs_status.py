"""Status and topics."""

from dataclasses import replace
from typing import Any

import msgpack
import pytest

from evs.msgs import (
    CLOCK,
    EVENTS,
    STATUS,
    TOPICS,
    MessageError,
    Status,
    decode_status,
    encode_status,
)
from evs.msgs.status import MAX_CAMERAS

WHOLE = Status(
    camera="track",
    seq=99,
    packets=100,
    events=2**40,
    time_end_us=100_000,
    end=True,
    width=346,
    height=260,
    sensor="davis346",
    tick_us=1000,
    seed=2**64 - 1,
    cameras=("egocentric", "track"),
)


def test_round_trip() -> None:
    assert decode_status(encode_status(WHOLE)) == WHOLE
    nothing_yet = replace(WHOLE, seq=-1, packets=0, events=0, time_end_us=0, end=False)
    assert decode_status(encode_status(nothing_yet)) == nothing_yet


def test_most_cameras_fit() -> None:
    names = tuple(f"{number:03d}" + "é" * 126 for number in range(MAX_CAMERAS))
    status = replace(WHOLE, camera=names[0], cameras=names)
    assert decode_status(encode_status(status)) == status


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seq", -2),
        ("seq", 2**63),
        ("packets", -1),
        ("events", 0.5),
        ("time_end_us", None),
        ("end", 1),
        ("end", None),
        ("width", 0),
        ("height", 40_000),
        ("sensor", ""),
        ("tick_us", 0),
        ("seed", 2**64),
        ("camera", "elsewhere"),
        ("camera", "\x00"),
        ("cameras", ()),
        ("cameras", ("track", 3)),
        ("cameras", ("track",) * (MAX_CAMERAS + 1)),
    ],
)
def test_bad_values_are_refused_at_both_ends(name: str, value: Any) -> None:
    with pytest.raises(MessageError) as caught:
        encode_status(replace(WHOLE, **{name: value}))
    assert "\n" not in str(caught.value)
    wire = msgpack.unpackb(encode_status(WHOLE))
    wire[{"time_end_us": "time_end"}.get(name, name)] = value
    if value == 2**64:
        return
    with pytest.raises(MessageError):
        decode_status(msgpack.packb(wire))


def test_every_field_is_needed() -> None:
    wire = msgpack.unpackb(encode_status(WHOLE))
    assert len(wire) == 13
    for name in wire:
        with pytest.raises(MessageError):
            decode_status(msgpack.packb({key: wire[key] for key in wire if key != name}))


def test_topics_are_name_and_camera() -> None:
    assert EVENTS.of("track") == b"events/track"
    assert STATUS.of("左") == "status/左".encode()
    assert CLOCK.of("track") == b"clock/"
    assert {topic.name for topic in TOPICS} == {
        *("events", "frames", "imu", "pose", "light", "ground_truth", "camera_info", "clock"),
        "status",
    }
