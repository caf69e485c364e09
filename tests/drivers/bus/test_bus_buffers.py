"""Memory that large frames are sent from: right copies, used again, and bounded."""

from __future__ import annotations

import time

import numpy as np
import pytest
import zmq

from evs.drivers.bus.publisher import LEAST_BYTES, MOST_BYTES, Buffers
from evs.drivers.bus.sockets import Context
from evs.msgs import EventPacket, MessageError, decode, encode, make_events

LARGE = LEAST_BYTES + 1


def frame_of(size: int, value: int) -> memoryview:
    return np.full(size, value, np.uint8).data


def test_a_frame_stays_what_it_was_while_its_source_changes() -> None:
    buffers = Buffers()
    with Context() as context, context.socket(zmq.PAIR) as one, context.socket(zmq.PAIR) as two:
        one.bind("inproc://frames")
        two.connect("inproc://frames")
        source = np.zeros(LARGE, np.uint8)
        for value in range(5):
            source[:] = value
            one.send_multipart([b"topic", buffers.copied(source.data)])
        source[:] = 99
        for value in range(5):
            topic, body = two.recv_multipart()
            assert topic == b"topic"
            assert body == bytes([value]) * LARGE


def test_memory_is_used_again_once_the_frame_is_gone() -> None:
    buffers = Buffers()
    with Context() as context, context.socket(zmq.PAIR) as one, context.socket(zmq.PAIR) as two:
        one.bind("inproc://again")
        two.connect("inproc://again")
        for value in range(40):
            one.send(buffers.copied(frame_of(LARGE, value)))
            assert two.recv() == bytes([value]) * LARGE
            until = time.monotonic() + 20
            while not buffers._lent[-1][1].done:
                assert time.monotonic() < until, "it is never given back"
                time.sleep(0.001)
        assert len(buffers._lent) == 1
        # a larger frame takes its place
        one.send(buffers.copied(frame_of(3 * LARGE, 7)))
        assert two.recv() == bytes([7]) * 3 * LARGE
        assert len(buffers._lent) == 1
        assert buffers.bytes < 4 * LARGE


def test_short_frames_and_too_many_of_them_are_left_to_zeromq() -> None:
    buffers = Buffers()
    short = frame_of(LEAST_BYTES - 1, 1)
    assert buffers.copied(short) is short
    # nobody takes them: each needs memory of its own
    kept = [buffers.copied(frame_of(LARGE, 1)) for _ in range(200)]
    lent = [one for one in kept if isinstance(one, zmq.Frame)]
    assert 50 < len(lent) < 200
    assert buffers.bytes <= MOST_BYTES


def test_a_publisher_that_forgets_its_frames_closes_all_the_same() -> None:
    with Context() as context:
        server = context.socket(zmq.XPUB)
        server.bind("tcp://127.0.0.1:0")
        client = context.socket(zmq.SUB)
        client.subscribe(b"")
        client.connect(server.get(zmq.LAST_ENDPOINT))
        server.recv()
        buffers = Buffers()
        for value in range(20):
            server.send(buffers.copied(frame_of(4 * LARGE, value)))
        del buffers
        assert client.recv() == bytes([0]) * 4 * LARGE
        client.close(linger=0)
        server.close(linger=0)


@pytest.mark.parametrize("place", [0, 1, 32_767, 32_768, 32_769, 39_999])
@pytest.mark.parametrize("what", ["t", "x", "y", "p", "padding"])
def test_one_bad_event_of_many_is_found_wherever_it_stands(place: int, what: str) -> None:
    t = np.arange(40_000) // 40 + 1
    events = make_events(t, t % 346, t % 260, t % 2)
    good = EventPacket(0, 0, 1000, 346, 260, events, "cam")
    header, raw = encode(good)
    body = np.frombuffer(raw, np.uint8).reshape(-1, 16).copy()
    assert decode(header, body.reshape(-1).data).events.tobytes() == events.tobytes()
    one = body[place]
    if what == "t":
        # before the event that precedes it; the first one: after the next
        one[:8] = np.array([0 if place else 900], "<i8").view(np.uint8)
    elif what == "x":
        one[8:10] = np.array([346], "<u2").view(np.uint8)
    elif what == "y":
        # also as a negative number
        one[10:12] = np.array([260 if place % 2 else 0xFFFF], "<u2").view(np.uint8)
    elif what == "p":
        one[12] = 2
    else:
        one[13 + place % 3] = 1
    with pytest.raises(MessageError):
        decode(header, body.reshape(-1).data)


def test_garbage_in_the_padding_stays_here() -> None:
    events = make_events([1, 2, 3], [4, 5, 6], [1, 2, 3], [0, 1, 1])
    dirty = events.copy()
    dirty.view(np.uint8).reshape(-1, 16)[:, 13:] = 77
    packet = EventPacket(0, 0, 1000, 346, 260, dirty, "cam")
    assert bytes(encode(packet)[1]) == events.tobytes()
