"""Whatever bytes come, a packet keeps its promises or is refused with MessageError."""

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.msgs import (
    EventPacket,
    MessageError,
    Status,
    decode,
    decode_status,
    encode,
    encode_status,
    make_events,
)

pytestmark = pytest.mark.property

SENT = EventPacket(
    7, 7000, 8000, 346, 260, make_events([7001, 7400, 8000], [1, 2, 3], [4, 5, 6], [1, 0, 1]), "cam"
)
HEADER, FRAME = encode(SENT)[0], bytes(encode(SENT)[1])
STATUS_HEADER = encode_status(
    Status("cam", 7, 8, 99, 8000, False, 346, 260, "ideal", 1000, 0, ("cam",))
)

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text()
    | st.binary(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)


def judged(header: bytes, frame: bytes) -> EventPacket | None:
    """Decoded and checked against the promises of EventPacket, or None where it was refused."""
    try:
        packet = decode(header, frame)
    except MessageError:
        return None
    assert 0 <= packet.seq < 2**63
    assert 1 <= packet.width < 2**15
    assert 1 <= packet.height < 2**15
    assert isinstance(packet.camera, str)
    assert packet.camera
    t, x, y, p = (packet.events[name].astype(object) for name in "txyp")
    assert list(t) == sorted(t)
    assert all(packet.time_base_us < stamp <= packet.time_end_us for stamp in t)
    assert all(0 <= place < packet.width for place in x)
    assert all(0 <= place < packet.height for place in y)
    assert set(p) <= {0, 1}
    assert not np.frombuffer(frame, np.uint8).reshape(-1, 16)[:, 13:].any()
    return packet


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(0, len(HEADER) - 1), st.integers(0, 255)), max_size=4))
def test_mutated_headers(changes: list[tuple[int, int]]) -> None:
    header = bytearray(HEADER)
    for place, value in changes:
        header[place] = value
    packet = judged(bytes(header), FRAME)
    assert packet is not None or bytes(header) != HEADER


@given(st.integers(0, len(STATUS_HEADER) - 1), st.integers(0, 255), st.integers(0, 10))
def test_mutated_statuses(place: int, value: int, cut: int) -> None:
    header = bytearray(STATUS_HEADER)
    header[place] = value
    try:
        status = decode_status(bytes(header[: len(header) - cut]))
    except MessageError:
        return
    # the last value is a time of three bytes: changed into one of a byte, it is whole with two less
    assert cut == 0 or (cut == 2 and place == len(header) - 3)
    assert -1 <= status.seq < 2**63
    assert status.camera in status.cameras


@given(st.binary(max_size=300), st.binary(max_size=64))
def test_any_bytes(header: bytes, frame: bytes) -> None:
    judged(header, frame)


@given(st.sampled_from(sorted(msgpack.unpackb(HEADER))), PLAIN)
def test_any_value_in_any_field(name: str, value: object) -> None:
    judged(msgpack.packb({**msgpack.unpackb(HEADER), name: value}), FRAME)


@given(st.lists(st.tuples(st.integers(0, len(FRAME) - 1), st.integers(0, 255)), max_size=3))
def test_mutated_frames(changes: list[tuple[int, int]]) -> None:
    frame = bytearray(FRAME)
    for place, value in changes:
        frame[place] = value
    packet = judged(HEADER, bytes(frame))
    if packet is not None:
        assert packet.events.tobytes() == bytes(frame)


@st.composite
def packets(draw: st.DrawFn) -> EventPacket:
    base = draw(st.integers(-(2**60), 2**60))
    end = base + draw(st.integers(1, 2**40))
    width, height = draw(st.integers(1, 32767)), draw(st.integers(1, 32767))
    count = draw(st.integers(0, 20))
    several = {"min_size": count, "max_size": count}
    return EventPacket(
        seq=draw(st.integers(0, 2**63 - 1)),
        time_base_us=base,
        time_end_us=end,
        width=width,
        height=height,
        events=make_events(
            np.array(sorted(draw(st.lists(st.integers(base + 1, end), **several))), np.int64),
            draw(st.lists(st.integers(0, width - 1), **several)),
            draw(st.lists(st.integers(0, height - 1), **several)),
            draw(st.lists(st.integers(0, 1), **several)),
        ),
        camera=draw(st.text(min_size=1, max_size=60).filter(str.isprintable)),
    )


@given(packets())
def test_every_good_packet_comes_back(sent: EventPacket) -> None:
    header, frame = encode(sent)
    got = judged(header, bytes(frame))
    assert got is not None
    assert got.events.tobytes() == sent.events.tobytes()
    for name in ("seq", "time_base_us", "time_end_us", "width", "height", "camera"):
        assert getattr(got, name) == getattr(sent, name)
