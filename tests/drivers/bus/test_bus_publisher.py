"""The publisher alone and with a subscriber in this process: errors, idleness, statuses, totals."""

import socket
from collections.abc import Iterator

import numpy as np
import pytest
import zmq

from evs.drivers.bus import Publisher, Subscription, publisher, subscribe
from evs.drivers.clock import monotonic_s, sleep_s
from evs.msgs import (
    EventPacket,
    EvsError,
    MessageError,
    StreamInfo,
    decode_status,
    encode,
    make_events,
)
from evs.msgs.packet import MAX_FRAME_BYTES

STREAM = StreamInfo(346, 260, "cam", sensor="davis346", seed=5)
ANY_PORT = "tcp://127.0.0.1:0"


def packet(seq: int, camera: str = "cam", events: int = 3) -> EventPacket:
    stamps = np.full(events, 1000 * seq + 500)
    filled = make_events(stamps, stamps % 346, stamps % 260, stamps % 2)
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, filled, camera)


@pytest.fixture
def port() -> int:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return int(server.getsockname()[1])


@pytest.fixture
def bus(port: int) -> Iterator[tuple[Publisher, Subscription]]:
    """A publisher of one camera and its only subscriber."""
    address = f"tcp://127.0.0.1:{port}"
    with subscribe(address, timeout_s=5) as stream:
        sender = Publisher(address, wait_for=1)
        sender.open([STREAM])
        yield sender, stream
        # the listener goes first, or the publisher would wait for it
        stream.close()
        sender.close()


def test_a_free_port_is_found_and_told() -> None:
    sender = Publisher(ANY_PORT)
    sender.open([STREAM])
    port = int(sender.address.rpartition(":")[2])
    assert port > 0
    report = sender.close()
    assert report["address"] == f"tcp://127.0.0.1:{port}"
    # the port is free again at once
    again = Publisher(sender.address)
    again.open([STREAM])
    again.close()


def test_ipv6_loopback_works_where_the_machine_has_it(port: int) -> None:
    sender = Publisher(f"tcp://[::1]:{port}", wait_for=1)
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        with pytest.raises(EvsError, match="cannot bind"):
            sender.open([STREAM])
        return
    with subscribe(f"tcp://[::1]:{port}", timeout_s=5) as stream:
        sender.open([STREAM])
        sender.write(packet(0))
        assert stream.receive(5) is not None
    sender.close()


def test_a_port_in_use_is_one_line_with_the_fix() -> None:
    first = Publisher(ANY_PORT)
    first.open([STREAM])
    second = Publisher(first.address)
    with pytest.raises(EvsError, match=r"port \d+ is in use.*another port") as caught:
        second.open([STREAM])
    assert "\n" not in str(caught.value)
    assert second.close()["packets_sent"] == 0
    first.close()


@pytest.mark.parametrize(
    "wrong",
    [
        {"wait_for": -1},
        {"wait_s": -1.0},
        {"wait_s": float("nan")},
        {"linger_s": float("nan")},
        {"queue": 0},
    ],
)
def test_absurd_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(EvsError, match=next(iter(wrong))):
        Publisher(ANY_PORT, **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "streams",
    [
        [],
        [STREAM, STREAM],
        [StreamInfo(346, 260, "")],
        [StreamInfo(346, 260, "a\nb")],
        [StreamInfo(0, 260, "a")],
        [StreamInfo(346, 260, "a", seed=2**70)],
    ],
)
def test_bad_streams_are_refused_and_the_port_stays_free(streams: list[StreamInfo]) -> None:
    sender = Publisher(ANY_PORT)
    with pytest.raises(EvsError):
        sender.open(streams)
    assert sender.close()["address"] == ANY_PORT


def test_use_before_open_and_twice_open_are_said() -> None:
    sender = Publisher(ANY_PORT)
    with pytest.raises(EvsError, match="not open"):
        sender.write(packet(0))
    assert sender.close() == sender.close()
    sender.open([STREAM])
    with pytest.raises(EvsError, match="open already"):
        sender.open([STREAM])
    with pytest.raises(EvsError, match="no camera on the bus 'can'; there is: cam"):
        sender.write(packet(0, "can"))
    sender.close()


def test_waiting_for_subscribers_ends_with_an_error_that_says_so() -> None:
    sender = Publisher(ANY_PORT, wait_for=2, wait_s=0.2)
    begin_s = monotonic_s()
    with pytest.raises(EvsError, match=r"0 of 2 subscribers came to tcp://.* within 0\.2 s"):
        sender.open([STREAM])
    assert 0.2 <= monotonic_s() - begin_s < 5
    # the port is released
    again = Publisher(sender.address)
    again.open([STREAM])
    again.close()


def test_nothing_is_encoded_or_sent_while_nobody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr(publisher, "encode", lambda one: calls.append(one) or encode(one))
    monkeypatch.setattr(publisher, "encode_status", lambda one: calls.append(one) or b"")
    sender = Publisher(ANY_PORT)
    sender.open([STREAM])
    calls.clear()
    for seq in range(300):
        sender.write(packet(seq))
    begin_s = monotonic_s()
    report = sender.close()
    # there is nobody to say goodbye to
    assert monotonic_s() - begin_s < 1
    assert calls == []
    assert report == {
        "type": "zmq",
        "address": sender.address,
        "packets_sent": 0,
        "events_sent": 0,
        "bytes_sent": 0,
        "statuses_sent": 0,
        "packets_unsubscribed": 300,
        "packets_oversized": 0,
    }


def test_a_subscriber_of_another_camera_costs_nothing(port: int) -> None:
    sender = Publisher(f"tcp://127.0.0.1:{port}", wait_for=1)
    with subscribe(sender.address, "right", timeout_s=5) as stream:
        sender.open([StreamInfo(346, 260, "left"), StreamInfo(346, 260, "right")])
        for seq in range(10):
            sender.write(packet(seq, "left"))
            sender.write(packet(seq, "right"))
        received = [stream.receive(5) for _ in range(10)]
        assert [one.camera for one in received if one] == ["right"] * 10
    report = sender.close()
    assert (report["packets_sent"], report["packets_unsubscribed"]) == (10, 10)


def test_statuses_come_at_every_tenth_of_a_second(bus: tuple[Publisher, Subscription]) -> None:
    sender, stream = bus
    seen = []
    for seq in range(250):
        sender.write(packet(seq))
        assert stream.receive(5) is not None
        if stream.status is not None and (not seen or seen[-1] != stream.status):
            seen.append(stream.status)
    assert [(one.packets, one.seq, one.events, one.end) for one in seen] == [
        (100, 99, 300, False),
        (200, 199, 600, False),
    ]
    first = seen[0]
    assert (first.camera, first.sensor, first.seed) == ("cam", "davis346", 5)
    assert (first.width, first.height, first.tick_us, first.cameras) == (346, 260, 1000, ("cam",))


def test_packets_that_no_subscriber_may_take_are_counted(
    bus: tuple[Publisher, Subscription], monkeypatch: pytest.MonkeyPatch
) -> None:
    sender, stream = bus
    assert MAX_FRAME_BYTES % 16 == 0
    monkeypatch.setattr(publisher, "MAX_FRAME_BYTES", 160)
    sender.write(packet(0, events=10))
    sender.write(packet(1, events=11))
    sender.write(packet(2, events=10))
    received = [stream.receive(5), stream.receive(5)]
    assert [one.seq for one in received if one] == [0, 2]
    assert stream.lost == 1
    stream.close()
    assert sender.close()["packets_oversized"] == 1


def test_a_packet_of_the_largest_frame_gets_through(bus: tuple[Publisher, Subscription]) -> None:
    sender, stream = bus
    sender.write(packet(0, events=MAX_FRAME_BYTES // 16))
    received = stream.receive(20)
    assert received is not None
    assert len(received) == MAX_FRAME_BYTES // 16


def test_a_broken_packet_is_an_error_here_and_not_at_every_subscriber(
    bus: tuple[Publisher, Subscription],
) -> None:
    sender, _ = bus
    backwards = make_events([900, 500], [1, 1], [1, 1], [0, 0])
    with pytest.raises(MessageError, match="not sorted"):
        sender.write(EventPacket(0, 0, 1000, 346, 260, backwards, "cam"))


def test_senders_may_reuse_their_memory(bus: tuple[Publisher, Subscription]) -> None:
    sender, stream = bus
    # over 64 kB, where pyzmq would share memory if asked to
    sent = packet(0, events=10_000)
    before = sent.events.tobytes()
    sender.write(sent)
    sent.events["x"] = 77
    received = stream.receive(5)
    assert received is not None
    assert received.events.tobytes() == before


def test_strange_clients_do_no_harm(bus: tuple[Publisher, Subscription]) -> None:
    sender, stream = bus
    host, port = "127.0.0.1", int(sender.address.rpartition(":")[2])
    with zmq.Context() as context, context.socket(zmq.XSUB) as client:
        client.set(zmq.LINGER, 0)
        client.connect(sender.address)
        for message in (b"", b"\x07", b"junk", b"\x00events/cam", b"\x01" + b"\xff" * 1000):
            client.send(message)
        client.send_multipart([b"\x01events/", b"cam"])
        with socket.create_connection((host, port)) as web:
            web.sendall(b"GET / HTTP/1.1\r\n\r\n")
            for seq in range(50):
                sender.write(packet(seq))
                sleep_s(0.002)
    for seq in range(50):
        received = stream.receive(5)
        assert received is not None
        assert received.seq == seq
    assert (stream.lost, stream.bad_messages) == (0, 0)


def test_the_end_is_repeated_for_clients_of_one_connection() -> None:
    """A subscriber that never leaves hears the end several times: any one may meet a full queue."""
    sender = Publisher(ANY_PORT, linger_s=0.2)
    sender.open([STREAM])
    with zmq.Context() as context, context.socket(zmq.SUB) as client:
        client.set(zmq.LINGER, 0)
        client.subscribe(b"")
        client.connect(sender.address)
        seq = 0
        while not client.poll(10):
            sender.write(packet(seq))
            seq += 1
        begin_s = monotonic_s()
        sender.close()
        assert 0.2 <= monotonic_s() - begin_s < 5
        last = []
        while client.poll(200):
            last.append(client.recv_multipart())
    ends = [decode_status(parts[1]) for parts in last if parts[0] == b"status/cam"]
    repeated = [one for one in ends if one.end]
    assert len(repeated) >= 3
    assert {(one.seq, one.packets, one.events) for one in repeated} == {(seq - 1, seq, 3 * seq)}
