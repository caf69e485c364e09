"""Strangers at the ports, a publisher that lies, a cut link: what is right still arrives."""

from __future__ import annotations

import resource
import select
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zmq

from evs.drivers.bus import Latest, Publisher, discover, subscribe
from evs.drivers.bus.address import free_address
from evs.drivers.bus.curve_keys import write_keys
from evs.drivers.clock import monotonic_s, sleep_s
from evs.msgs import EventPacket, StreamInfo, encode, encode_status, make_events
from evs.msgs.status import Status

pytestmark = pytest.mark.extremes

ANY = "tcp://127.0.0.1:0"


def packet(seq: int) -> EventPacket:
    events = make_events([1000 * seq + 1] * 3, [1, 2, 3], [4, 5, 6], [1, 0, 1])
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, events, "cam")


def port_of(address: str) -> int:
    return int(address.rpartition(":")[2])


class Sending:
    """A publisher that sends a packet a millisecond from a thread."""

    def __init__(self, address: str = ANY, **options: object) -> None:
        self.sender = Publisher(address, linger_s=0.1, **options)  # type: ignore[arg-type]
        self.sender.open([StreamInfo(346, 260, "cam")])
        self.seq, self._wanted = 0, True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while self._wanted:
            self.sender.write(packet(self.seq))
            self.seq += 1
            sleep_s(0.001)

    def stop(self) -> None:
        self._wanted = False
        self._thread.join()
        self.sender.close()


@pytest.fixture(params=[False, True], ids=["open", "keys"])
def guarded(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Sending, str]]:
    """A publisher with all its ports, and the public key that it wants, if any."""
    write_keys(tmp_path / "cam")
    key = str(tmp_path / "cam.secret.key") if request.param else ""
    sending = Sending(control=ANY, key=key)
    yield sending, str(tmp_path / "cam.key") if request.param else ""
    sending.stop()


def greeting(mechanism: bytes) -> bytes:
    """How a ZMTP 3.1 peer begins, so that what follows reaches the deeper parts."""
    head = b"\xff" + bytes(8) + b"\x7f\x03\x01"
    return head + mechanism.ljust(20, b"\0") + b"\0" + bytes(31)


def test_garbage_at_every_port_stops_nobody(guarded: tuple[Sending, str]) -> None:
    sending, server_key = guarded
    random = np.random.default_rng(0)
    told = sending.sender
    ports = [port_of(one) for one in (told.address, told.control_address, told.latest_address)]
    before = sending.seq
    for number in range(150):
        with socket.create_connection(("127.0.0.1", ports[number % 3])) as stranger:
            start = [b"", greeting(b"NULL"), greeting(b"CURVE"), b"GET / HTTP/1.1\r\n\r\n"]
            ready = b"\x04\x19\x05READY\x0bSocket-Type\0\0\0\x03SUB" if number % 2 else b""
            garbage = random.bytes(int(random.integers(1, 3000)))
            stranger.settimeout(5)
            try:
                stranger.sendall(start[number % 4] + ready + garbage)
            except OSError:
                # shown the door while it still spoke
                continue
    found = discover(told.control_address, timeout_s=20, server_key=server_key)
    with (
        subscribe(found.address, server_key=server_key) as stream,
        Latest(found.latest, server_key=server_key) as latest,
    ):
        received = [stream.receive(20) for _ in range(20)]
        assert [one.seq - received[0].seq for one in received if one and received[0]] == list(
            range(20)
        )
        assert (stream.lost, stream.bad_messages) == (0, 0)
        assert latest.get(20) is not None
    assert sending.seq > before


def test_a_frame_that_claims_too_much_is_not_waited_for(guarded: tuple[Sending, str]) -> None:
    """A length of 2^62 bytes costs no memory."""
    sending, _ = guarded
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for address in (sending.sender.address, sending.sender.control_address):
        with socket.create_connection(("127.0.0.1", port_of(address))) as stranger:
            stranger.settimeout(5)
            try:
                stranger.sendall(
                    greeting(b"NULL") + b"\x04\x19\x05READY\x0bSocket-Type\0\0\0\x03SUB"
                )
                stranger.sendall(b"\x02" + (2**62).to_bytes(8, "big") + bytes(100_000))
            except OSError:
                continue
    sleep_s(0.2)
    # what the other threads of this process take meanwhile is far below
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 100_000


def test_a_publisher_that_lies_is_counted_and_survived() -> None:
    """Thousands of wrong messages under every topic, among right ones."""
    random = np.random.default_rng(1)
    names = ("events", "frames", "imu", "pose", "ground_truth", "camera_info", "status", "x", "")
    header, _ = encode(packet(0))
    status = Status("cam", 0, 1, 3, 1000, False, 346, 260, "ideal", 1000, 0, ("cam",), {})
    right = [encode_status(status), header]
    address = free_address()
    wants = dict.fromkeys(("frames", "imu", "poses", "truths", "camera_info", "clock"), True)
    with (
        zmq.Context() as context,
        context.socket(zmq.XPUB) as liar,
        subscribe(address, **wants) as stream,  # type: ignore[arg-type]
    ):
        liar.set(zmq.LINGER, 0)
        liar.set(zmq.SNDHWM, 0)
        liar.bind(address)
        for _ in range(8):
            # each topic is told once
            assert liar.poll(10_000)
            liar.recv()
        sent = 0
        for number in range(4000):
            changed = bytearray(right[number % 2])
            changed[int(random.integers(len(changed)))] ^= int(random.integers(1, 256))
            parts = [f"{names[number % len(names)]}/cam".encode(), bytes(changed)]
            parts += [random.bytes(int(random.integers(64)))] * int(random.integers(5))
            liar.send_multipart(parts)
            if number % 400 == 0:
                liar.send_multipart([b"events/cam", *map(bytes, encode(packet(sent)))])
                sent += 1
        found = []
        while len(found) < sent and (one := stream.receive(10)) is not None:
            if one.seq == len(found) and len(one) == 3:
                found.append(one)
        assert len(found) == sent
        # most names are subscribed to, and a wrong message stays a wrong one
        assert stream.bad_messages > 1000
        assert len(stream.frames) + len(stream.poses) < 4000


class Link:
    """A wire between two ports that can be cut: nothing passes, and both ends hear of it later."""

    def __init__(self, target: int) -> None:
        self.cut = False
        self._target, self._server = target, socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self._wanted, self._dead = True, []  # type: ignore[var-annotated]
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        peers: dict[socket.socket, socket.socket] = {}
        while self._wanted:
            if self.cut and peers:
                # kept open, and not read: no end, no reset
                self._dead += peers
                peers = {}
            if not self.cut:
                self._end_dead()
            listening = [] if self.cut else [self._server, *peers]
            for ready in select.select(listening, [], [], 0.02)[0]:
                if ready is self._server:
                    near, _ = self._server.accept()
                    far = socket.create_connection(("127.0.0.1", self._target))
                    peers |= {near: far, far: near}
                    continue
                if ready in peers and not self._pass_on(ready, peers[ready]):
                    other = peers.pop(ready)
                    peers.pop(other, None)
                    ready.close()
                    other.close()
        self._end_dead()
        for one in [*peers, self._server]:
            one.close()

    @staticmethod
    def _pass_on(near: socket.socket, far: socket.socket) -> bool:
        """Whether both ends are still there."""
        try:
            passed = near.recv(65536)
            far.sendall(passed)
        except OSError:
            # whoever gives up first resets the connection
            return False
        return bool(passed)

    def _end_dead(self) -> None:
        """As a router does that has forgotten them. Its own patience: test_network_link_bus.py."""
        for one in self._dead:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            one.close()
        self._dead.clear()

    def stop(self) -> None:
        self._wanted = False
        self._thread.join()


def test_a_link_is_cut_and_losses_are_counted() -> None:
    sending = Sending()
    link = Link(port_of(sending.sender.address))
    try:
        with subscribe(link.address, timeout_s=30) as stream:
            first = stream.receive(20)
            assert first is not None
            link.cut = True
            while stream.receive(1.0) is not None:
                # what was on its way
                continue
            link.cut = False
            again = stream.receive(20)
            assert again is not None
            # everything between was lost, and is counted
            assert stream.lost > 0
            assert first.seq + stream.packets + stream.lost == again.seq + 1
            assert stream.restarts == 0
            # the publisher lets go of who was behind the cut
            deadline_s = monotonic_s() + 20
            while sending.sender.subscribers != 1:
                assert monotonic_s() < deadline_s
                sleep_s(0.05)
    finally:
        link.stop()
        sending.stop()
