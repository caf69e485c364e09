"""Bytes from strangers: a message is right, or refused in one line, in little time and memory."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.bus.auxiliary import AuxiliaryMessages
from evs.drivers.bus.channels import Audience, make_channels
from evs.msgs import (
    TRUTH_CHANNELS,
    CameraInfo,
    CameraState,
    Clock,
    EventPacket,
    Frame,
    ImuPacket,
    MessageError,
    Pose,
    State,
    Status,
    StreamInfo,
    Truth,
    decode,
    decode_camera_info,
    decode_clock,
    decode_frame,
    decode_imu,
    decode_pose,
    decode_state,
    decode_status,
    decode_truth,
    empty_imu,
    encode,
    encode_camera_info,
    encode_clock,
    encode_frame,
    encode_imu,
    encode_pose,
    encode_state,
    encode_status,
    encode_truth,
    make_events,
)

pytestmark = pytest.mark.property

CASES = 16_000
"""of each of the eight messages: 128,000 in all"""
SLACK_BYTES = 10_000_000
"""beyond twice the input: 1000 nested lists of 1000 claimed items, 8 bytes each, and an error"""

EVENTS = make_events([7001, 7400, 8000], [1, 2, 3], [4, 5, 6], [1, 0, 1])
TRUTH = Truth(
    3,
    4000,
    {
        key: np.ones((4, 5) if count == 1 else (4, 5, count), kind)
        for key, (kind, count) in TRUTH_CHANNELS.items()
    },
    "cam",
)
NINE, TWELVE = (1.0,) * 9, (1.0,) * 12

Parts = tuple[bytes, ...]
MESSAGES: dict[str, tuple[Parts, Callable[..., Any], Callable[[Any], Any]]] = {
    "events": (
        tuple(map(bytes, encode(EventPacket(7, 7000, 8000, 346, 260, EVENTS, "cam")))),
        decode,
        encode,
    ),
    "frames": (
        tuple(map(bytes, encode_frame(Frame(1, 0, 1, 2, 3, np.ones((4, 6), np.uint16), "cam")))),
        decode_frame,
        encode_frame,
    ),
    "imu": (
        tuple(map(bytes, encode_imu(ImuPacket(1, empty_imu(2), "cam")))),
        decode_imu,
        encode_imu,
    ),
    "truth": (tuple(map(bytes, encode_truth(TRUTH))), decode_truth, encode_truth),
    "pose": (
        (encode_pose(Pose(1, 2, (1, 2, 3), (0, 0, 0, 1), "cam")),),
        decode_pose,
        encode_pose,
    ),
    "camera_info": (
        (encode_camera_info(CameraInfo("cam", 3, 2, "none", (), NINE, NINE, TWELVE)),),
        decode_camera_info,
        encode_camera_info,
    ),
    "status": (
        (
            encode_status(
                Status(
                    "cam", 7, 8, 99, 8000, False, 346, 260, "ideal", 1000, 0, ("cam",), {"imu": 3}
                )
            ),
        ),
        decode_status,
        encode_status,
    ),
    "state": (
        (encode_state(State(5, (CameraState("cam", 1, 2, 3, False, (1.0, 2.0, 3.0)),))),),
        decode_state,
        encode_state,
    ),
}


def mutated(parts: Parts, seed: int, count: int) -> Iterator[Parts]:
    """Cut, changed in some bytes, grown, swapped, or with the bytes of a great claim put in."""
    random = np.random.default_rng(seed)
    claims = [b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc1"]
    for _ in range(count):
        changed = [bytearray(part) for part in parts]
        part = changed[random.integers(len(changed))]
        kind = random.integers(6)
        place = int(random.integers(len(part) + 1))
        if kind == 0:
            del part[place:]
        elif kind == 1:
            for _ in range(random.integers(1, 4)):
                part[int(random.integers(len(part)))] = int(random.integers(256))
        elif kind == 2:
            part[place:place] = random.bytes(int(random.integers(1, 40)))
        elif kind == 3:
            part[place:place] = claims[random.integers(len(claims))] * int(random.integers(1, 50))
        elif kind == 4:
            del part[place : place + int(random.integers(1, 9))]
        else:
            changed[0] = bytearray(random.bytes(len(changed[0])))
        yield tuple(map(bytes, changed))


def said(decoder: Callable[..., Any], parts: Parts) -> Any:
    """The message, None where it was refused in one line; anything else fails the test."""
    line = ""
    try:
        return decoder(*parts)
    except MessageError as reason:
        line = str(reason)
    assert "\n" not in line
    assert len(line) < 2000
    return None


@pytest.mark.slow
@pytest.mark.parametrize("name", MESSAGES)
def test_mutated_messages_are_refused_or_right(name: str) -> None:
    parts, decoder, encoder = MESSAGES[name]
    assert said(decoder, parts) is not None
    refused = 0
    for changed in mutated(parts, 1, CASES):
        found = said(decoder, changed)
        refused += found is None
        if found is not None:
            # what came through can be said again, and comes through again
            again = encoder(found)
            again = (again,) if isinstance(again, bytes) else tuple(map(bytes, again))
            assert said(decoder, again) is not None
    # most mutations break something
    assert refused > CASES / 4


@pytest.mark.parametrize(
    "header",
    [
        b"\xdd\xff\xff\xff\xff" * 800,
        b"\xdc\x03\xe8" * 21_000,
        b"\xdf\xff\xff\xff\xff" * 800,
        b"\x91" * 65_000,
        b"\x81\xa1a" * 20_000,
        b"\xdb\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xc9\xff\xff\xff\xff\x01",
        msgpack.packb({"camera": "x" * 60_000}),
        msgpack.packb({"seq": 2**63 - 1, "d": [1.0] * 900}),
    ],
    ids=range(10),
)
@pytest.mark.parametrize("name", MESSAGES)
def test_great_claims_cost_neither_memory_nor_time(name: str, header: bytes) -> None:
    parts, decoder, _ = MESSAGES[name]
    attack = (b"state/" + header if name == "state" else header, *parts[1:])
    begin_s = time.monotonic()
    tracemalloc.start()
    try:
        assert said(decoder, attack) is None
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak <= 2 * sum(map(len, attack)) + SLACK_BYTES
    # a loaded machine is slow, a hang is not over in 5 s
    assert time.monotonic() - begin_s < 5


@given(st.text(max_size=30), st.text(max_size=30), st.lists(st.binary(max_size=200), max_size=4))
def test_whatever_stands_before_it(kind: str, camera: str, rest: list[bytes]) -> None:
    beside = AuxiliaryMessages()
    parts = [f"{kind}/{camera}".encode(errors="replace"), *rest]
    try:
        taken = beside.take(kind, camera, parts)
    except MessageError:
        taken = False
    assert not taken
    assert beside.hand_out() == []


def test_a_topic_of_another_camera_is_refused() -> None:
    beside = AuxiliaryMessages()
    header = encode_pose(Pose(1, 2, (1, 2, 3), (0, 0, 0, 1), "cam"))
    with pytest.raises(MessageError, match="under the topic of another"):
        beside.take("pose", "left", [b"pose/left", header])
    assert beside.take("pose", "cam", [b"pose/cam", header])
    assert beside.take("clock", "", [b"clock/", encode_clock(Clock(5))])
    assert beside.clock == decode_clock(encode_clock(Clock(5)))


def test_frames_without_events_do_not_fill_the_memory() -> None:
    """A publisher that never sends the packet which frames come before."""
    beside = AuxiliaryMessages()
    header, raw = encode_frame(Frame(1, 0, 1, 2, 3, np.ones((4000, 4000), np.uint8), "cam"))
    body = bytes(raw)
    for _ in range(100):
        beside.take("frames", "cam", [b"frames/cam", header, body])
    kept = beside.hand_out()
    assert 1 < len(kept) * len(body) <= 512 * 1024 * 1024
    assert len(kept) < 100


@given(st.lists(st.binary(max_size=20), max_size=50))
def test_any_requests_leave_the_counts_of_listeners_right(requests: list[bytes]) -> None:
    audience = Audience(make_channels([StreamInfo(3, 2, "cam")]))
    for request in requests:
        audience.take(request)
    counts = list(audience.channels["cam"].listeners.values())
    assert all(0 <= count <= len(requests) for count in [*counts, audience.clock])
    before = audience.subscribers
    audience.take(b"\x01events/cam")
    assert audience.subscribers == before + 1
