"""One socket of the bus, with a full inbound queue, whose peer vanishes; then another peer comes.

    python vanished_peer.py KIND SECONDS

The peer is bytes on a plain socket, so that it can do what our ZeroMQ never does. SECONDS pass
between its end and the next use of the socket. The program prints "alive" if everything works.
"""

from __future__ import annotations

import socket
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from threading import Thread

from evs.drivers.bus import Latest, Publisher, subscribe
from evs.drivers.bus.control import request
from evs.drivers.bus.exchange import ClientEnd, ServerEnd
from evs.drivers.bus.ports import ServerKeys
from evs.drivers.clock import monotonic_s, sleep_s
from evs.msgs import EventPacket, StreamInfo, encode, make_events
from evs.msgs.packet import packb

ANY = "tcp://127.0.0.1:0"
MESSAGES = 3000
"""three times as many as wait in a socket by default"""
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)


def frame(body: bytes, flags: int = 0) -> bytes:
    """Return a frame of ZMTP.

    Args:
        body: The bytes that it carries.
        flags: 1 if more frames of the message follow, 4 for a command; their sum for both.
    """
    if len(body) < 256:
        return bytes([flags, len(body)]) + body
    return bytes([flags | 2]) + len(body).to_bytes(8, "big") + body


def ready(kind: str, identity: bytes) -> bytes:
    """Return the last message of a handshake without keys."""
    told = {b"Socket-Type": kind.encode(), b"Identity": identity}
    rows = (bytes([len(k)]) + k + len(v).to_bytes(4, "big") + v for k, v in told.items())
    return frame(b"\x05READY" + b"".join(rows), 4)


PING = frame(b"\x04PING" + bytes(2), 4)
OPEN: list[socket.socket] = []
"""sockets that are closed at the end"""


class Peer:
    """Bytes on a socket, after a handshake that does not wait for that of the other end."""

    def __init__(self, link: socket.socket, kind: str, identity: bytes = b"") -> None:
        self.link = link
        OPEN.append(link)
        link.settimeout(0.5)
        link.sendall(GREETING + ready(kind, identity))
        # until the handshake of the other end has come, it may not be listening yet
        self.heard = b""
        while len(self.heard) < len(GREETING) + 2 or b"READY" not in self.heard:
            self.heard += link.recv(65536)

    @classmethod
    def to(cls, address: str, kind: str, identity: bytes = b"") -> Peer:
        """Connect to an address as a socket of this kind."""
        port = int(address.rpartition(":")[2])
        return cls(socket.create_connection(("127.0.0.1", port), timeout=10), kind, identity)

    def flood(self, message: bytes) -> None:
        """Send a message MESSAGES times, or as often as the other end takes it."""
        with suppress(TimeoutError):
            self.link.sendall(message * MESSAGES)

    def vanish(self) -> None:
        """Close without a goodbye: only the system may notify the other end."""
        self.link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.link.close()


class Server:
    """A port that accepts such peers."""

    def __init__(self) -> None:
        self.port = socket.create_server(("127.0.0.1", 0))
        OPEN.append(self.port)
        self.port.settimeout(20)
        self.address = f"tcp://127.0.0.1:{self.port.getsockname()[1]}"

    def peer(self, kind: str) -> Peer:
        """Accept the next peer."""
        return Peer(self.port.accept()[0], kind)


def packet(seq: int) -> EventPacket:
    events = make_events([1000 * seq + 1] * 3, [1, 2, 3], [4, 5, 6], [1, 0, 1])
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, events, "cam")


def subscriber(wait: Callable[[], None]) -> None:
    """SUB, with both of its connections."""
    header, raw = encode(packet(0))
    message = frame(b"events/cam", 1) + frame(header, 1) + frame(bytes(raw))
    server = Server()
    with subscribe(server.address, queue=1) as stream:
        for one in [server.peer("XPUB") for _ in range(2)]:
            one.flood(message)
            one.vanish()
        wait()
        while stream.receive(1.0) is not None:
            continue
        assert stream.packets >= 1
        again = [server.peer("XPUB") for _ in range(2)]
        for one in again:
            one.link.sendall(message)
        assert stream.receive(20) is not None


def latest(wait: Callable[[], None]) -> None:
    """SUB with CONFLATE."""
    server = Server()
    with Latest(server.address) as client:
        peer = server.peer("PUB")
        peer.flood(frame(b"state" + bytes(200)))
        peer.vanish()
        wait()
        assert client.get(0) is None
        server.peer("PUB")


def publisher(wait: Callable[[], None], port: str = "address", flood: bytes = b"") -> None:
    """XPUB."""
    sender = Publisher(ANY, control=ANY, linger_s=0)
    sender.open([StreamInfo(346, 260, "cam")])
    peer = Peer.to(getattr(sender, port), "REQ" if "control" in port else "SUB")
    peer.flood((flood or frame(b"\x01events")) + PING)
    peer.vanish()
    wait()
    with subscribe(sender.address) as stream:
        for seq in range(2000):
            sender.write(packet(seq))
            if stream.receive(0.01) is not None:
                break
        assert stream.packets
    sender.close()


def latest_port(wait: Callable[[], None]) -> None:
    """PUB with CONFLATE."""
    publisher(wait, "latest_address")


def control_port(wait: Callable[[], None]) -> None:
    """ROUTER, flooded with requests."""
    asked = frame(b"", 1) + frame(packb({"request": "describe"}))
    publisher(wait, "control_address", asked)


def lockstep_server(wait: Callable[[], None]) -> None:
    """ROUTER of lock-step, and a second client that uses the name of the first."""
    server = ServerEnd(ANY, ServerKeys(), 1 << 20)
    peers = [Peer.to(server.address, "DEALER", b"twice") for _ in range(2)]
    for peer in peers:
        # the second takes the place of the first
        with suppress(OSError):
            peer.flood(frame(packb({"request": "hello", "number": 1})) + PING)
        peer.vanish()
    wait()
    deadline_s = monotonic_s() + 20
    while server.receive() is not None:
        assert monotonic_s() < deadline_s
    Peer.to(server.address, "DEALER").link.sendall(frame(b"again"))
    while server.receive() is None:
        assert monotonic_s() < deadline_s
    server.close()


def lockstep_client(wait: Callable[[], None]) -> None:
    """DEALER."""
    server = Server()
    client = ClientEnd(server.address, "", None, 1 << 20)
    peer = server.peer("ROUTER")
    peer.flood(frame(packb({"number": 1})))
    peer.vanish()
    wait()
    while client.receive() is not None:
        continue
    server.peer("ROUTER").link.sendall(frame(b"again"))
    deadline_s = monotonic_s() + 20
    while client.receive() is None:
        assert monotonic_s() < deadline_s
    client.close()


def control_client(wait: Callable[[], None]) -> None:
    """REQ, at the control port."""
    server = Server()

    def answer() -> None:
        peer = server.peer("ROUTER")
        peer.flood(frame(b"", 1) + frame(packb({"ok": True})) + PING)
        wait()
        peer.vanish()

    answering = Thread(target=answer)
    answering.start()
    assert request(server.address, "stop")["ok"]
    answering.join()


KINDS = {
    one.__name__: one
    for one in (
        subscriber,
        latest,
        publisher,
        latest_port,
        control_port,
        lockstep_server,
        lockstep_client,
        control_client,
    )
}

if __name__ == "__main__":
    KINDS[sys.argv[1]](lambda: sleep_s(float(sys.argv[2])))
    for link in OPEN:
        link.close()
    print("alive")
