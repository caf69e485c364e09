"""The subscriber against publishers that misbehave, and against nobody."""

import socket
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
import pytest
import zmq

from evs.drivers.bus import Subscription, subscribe, subscriber
from evs.drivers.clock import monotonic_s, sleep_s
from evs.msgs import EventPacket, EvsError, Status, encode, encode_status, make_events


def packet(seq: int, camera: str = "cam") -> EventPacket:
    filled = make_events([1000 * seq + 1], [seq % 8], [0], [1])
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 8, 8, filled, camera)


def status(seq: int, *, end: bool = False, camera: str = "cam", cameras: Any = None) -> bytes:
    names = (camera,) if cameras is None else cameras
    return encode_status(
        Status(camera, seq, seq + 1, 0, 1000 * seq + 1000, end, 8, 8, "ideal", 1000, 0, names)
    )


@pytest.fixture
def rogue() -> Iterator[zmq.Socket[bytes]]:
    """A publisher that sends whatever the test likes."""
    with zmq.Context() as context, context.socket(zmq.XPUB) as server:
        server.set(zmq.LINGER, 0)
        server.set(zmq.XPUB_VERBOSER, 1)
        server.set(zmq.SNDHWM, 0)
        server.bind("tcp://127.0.0.1:0")
        yield server


def joined(server: zmq.Socket[bytes], camera: str = "", **options: Any) -> Subscription:
    """A subscription to the rogue whose three requests have arrived."""
    address = bytes(server.get(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode()
    stream = subscribe(address, camera, **options)
    for _ in range(3):
        assert server.poll(5000)
        server.recv()
    return stream


def send_packet(server: zmq.Socket[bytes], one: EventPacket) -> None:
    header, frame = encode(one)
    server.send_multipart([b"events/" + one.camera.encode(), header, frame])


def test_garbage_is_counted_and_skipped(rogue: zmq.Socket[bytes]) -> None:
    header, frame = encode(packet(0))
    good = msgpack.unpackb(header)
    garbage = [
        [b"events/"],
        [b"events/cam"],
        [b"events/cam", header],
        [b"events/cam", header, bytes(frame), b""],
        [b"events/cam", b"", b""],
        [b"events/cam", b"\xc1", bytes(frame)],
        [b"events/cam", header, bytes(frame)[:-1]],
        [b"events/cam", b"\x91" * 1000, b""],
        [b"events/cam", msgpack.packb({**good, "seq": -5}), bytes(frame)],
        [b"events/cam", msgpack.packb({**good, "camera": "other"}), bytes(frame)],
        [b"events/\xff", header, bytes(frame)],
        [b"events/cam", header, b"\xff" * 16],
        [b"events/cam", np.random.default_rng(1).bytes(500), np.random.default_rng(2).bytes(160)],
        [b"status/cam"],
        [b"status/cam", b"\x80"],
        [b"status/cam", status(3), b""],
        [b"status/other", status(3)],
    ]
    with joined(rogue) as stream:
        for number, parts in enumerate(garbage):
            rogue.send_multipart(parts)
            send_packet(rogue, packet(number))
            received = stream.receive(5)
            assert received is not None
            assert received.seq == number
            assert stream.bad_messages == number + 1
        assert (stream.lost, stream.restarts, stream.ended) == (0, 0, False)


@pytest.mark.slow
def test_a_flood_of_garbage_cannot_hold_us_beyond_the_timeout(rogue: zmq.Socket[bytes]) -> None:
    with joined(rogue, queue=100_000) as stream:
        for _ in range(50_000):
            rogue.send_multipart([b"events/cam", b"", b""])
        # let them arrive, so that every look at the socket finds one more
        sleep_s(0.5)
        assert stream.receive(0) is None
        assert 0 < stream.bad_messages < 50_000


def test_a_stranger_cannot_invent_cameras_without_end(
    rogue: zmq.Socket[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subscriber, "MAX_CAMERAS", 3)
    with joined(rogue) as stream:
        for number in range(5):
            send_packet(rogue, packet(0, f"cam{number}"))
        send_packet(rogue, packet(1, "cam2"))
        while (received := stream.receive(5)) is not None and received.seq == 0:
            pass
        assert (len(stream.tallies), stream.packets, stream.bad_messages) == (3, 4, 2)


def test_too_large_a_message_is_never_taken_in_and_counts_as_lost(
    rogue: zmq.Socket[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subscriber, "MAX_FRAME_BYTES", 10_000)
    with joined(rogue) as stream:
        send_packet(rogue, packet(0))
        assert stream.receive(5) is not None
        # ZeroMQ cuts the main connection for good; the side connection stays
        rogue.send_multipart([b"events/cam", encode(packet(1))[0], bytes(16 * 1000)])
        assert stream.receive(0.1) is None
        assert sorted(rogue.recv() for _ in range(2) if rogue.poll(5000)) == [
            b"\x00events/",
            b"\x00status/",
        ]
        rogue.send_multipart([b"status/cam", status(2, end=True)])
        assert stream.receive(5) is None
        assert stream.ended
        assert (stream.packets, stream.lost, stream.bad_messages) == (1, 2, 0)


def test_longer_camera_names_are_somebody_elses(rogue: zmq.Socket[bytes]) -> None:
    with joined(rogue, "cam") as stream:
        send_packet(rogue, packet(5, "cam2"))
        rogue.send_multipart([b"status/cam2", status(3, end=True, camera="cam2")])
        send_packet(rogue, packet(0))
        received = stream.receive(5)
        assert received is not None
        assert received.camera == "cam"
        assert (stream.bad_messages, list(stream.tallies), stream.ended) == (0, ["cam"], False)


def test_the_stream_ends_when_the_last_camera_does(rogue: zmq.Socket[bytes]) -> None:
    both = ("left", "right")
    with joined(rogue) as stream:
        send_packet(rogue, packet(0, "left"))
        rogue.send_multipart([b"status/left", status(0, end=True, camera="left", cameras=both)])
        send_packet(rogue, packet(0, "right"))
        assert [stream.receive(5) is not None for _ in range(2)] == [True, True]
        assert stream.receive(0.05) is None
        assert not stream.ended
        rogue.send_multipart([b"status/right", status(4, end=True, camera="right", cameras=both)])
        assert stream.receive(5) is None
        assert stream.ended
        assert (stream.packets, stream.lost) == (2, 4)


def test_an_ended_stream_lets_the_publisher_go(rogue: zmq.Socket[bytes]) -> None:
    with joined(rogue) as stream:
        rogue.send_multipart([b"status/cam", status(-1, end=True)])
        assert list(stream) == []
        assert stream.ended
        gone = [rogue.recv() for _ in range(3) if rogue.poll(5000)]
        assert sorted(gone) == [b"\x00events/", b"\x00status/", b"\x00status/"]


def test_packets_behind_the_announced_end_are_waited_for(rogue: zmq.Socket[bytes]) -> None:
    """The end is heard on the side first: packets under way count, the rest is lost."""
    with joined(rogue, "cam") as stream:
        send_packet(rogue, packet(0))
        assert stream.receive(5) is not None
        # the side connection alone hears it, as if the main one had a full queue
        stream._main.unsubscribe(b"status/cam")
        assert rogue.poll(5000)
        assert rogue.recv() == b"\x00status/cam"
        rogue.send_multipart([b"status/cam", status(9, end=True)])
        assert stream.receive(0.1) is None
        assert not stream.ended
        send_packet(rogue, packet(1))
        send_packet(rogue, packet(7))
        begin_s = monotonic_s()
        assert [one.seq for one in stream] == [1, 7]
        assert stream.ended
        assert monotonic_s() - begin_s >= subscriber.END_GRACE_S
        assert (stream.packets, stream.lost) == (3, 7)
        assert stream.status is not None
        assert stream.status.end


def test_nobody_there_is_a_timeout() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with subscribe(address, timeout_s=0.1) as stream:
            begin_s = monotonic_s()
            assert list(stream) == []
            assert 0.1 <= monotonic_s() - begin_s < 5
            assert not stream.ended
            assert stream.status is None


def test_something_else_on_the_port_is_a_timeout() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        with subscribe(f"tcp://127.0.0.1:{server.getsockname()[1]}") as stream:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"220 mail.example ESMTP ready\r\n" * 100)
                assert stream.receive(0.2) is None
        assert (stream.packets, stream.bad_messages, stream.totals()["status"]) == (0, 0, None)


@pytest.mark.parametrize(
    "wrong",
    [
        {"address": "127.0.0.1:5560"},
        {"address": "tcp://127.0.0.1:0"},
        {"camera": "a\nb"},
        {"queue": 0},
        {"timeout_s": -1},
        {"timeout_s": float("nan")},
    ],
)
def test_bad_arguments_are_one_line(wrong: dict[str, Any]) -> None:
    with pytest.raises(EvsError) as caught:
        subscribe(**{"address": "tcp://127.0.0.1:5560", **wrong})
    assert "\n" not in str(caught.value)


def test_closed_is_closed() -> None:
    stream = subscribe("tcp://127.0.0.1:5560")
    stream.close()
    stream.close()
    assert stream.receive(0) is None
    assert list(stream) == []
    assert not stream.ended
