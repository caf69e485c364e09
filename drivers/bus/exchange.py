"""Requests and answers between processes: the two ends of lock-step, without what is said there.

The server is a ROUTER with any number of clients (REQ ones, too), a client a DEALER. Both notice a
connection that closes; one that comes back within RETURN_S was never away.
"""

from __future__ import annotations

import os
from typing import Any

import zmq
from zmq.utils.monitor import recv_monitor_message

from evs.drivers.bus.address import check_unused, is_ipv6, leave
from evs.drivers.bus.keys import Keys, ZapAuthenticator, guard, new_keys, present
from evs.drivers.bus.ports import ServerKeys, bind_error
from evs.drivers.bus.sockets import (
    Context,
    Handshakes,
    Socket,
    notice_death,
    readable,
    serve_anybody,
)
from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError

RETURN_S = 1.0
"""How long a connection that closed may take to come back before its other end counts as gone."""

_SLICE_MS = 50
"""Longest time in which nothing but messages is looked at: gates, closed connections, signals."""
_MOST_PARTS = 2
"""Frames of a request: header and body."""
_ANSWERS = 64
"""Answers held for a client that does not take them."""

Peer = tuple[bytes, ...]
"""Where a request came from and its answer goes to: identity, and REQ's empty frame."""


class ServerEnd:
    """Takes requests and answers them. One thread uses it."""

    def __init__(self, address: str, keys: ServerKeys, largest: int) -> None:
        """Bind. In: address, checked; largest, bytes of a frame. EvsError where it cannot be."""
        self._context = Context()
        self._authenticator = (
            None if keys.own is None else ZapAuthenticator(self._context, keys.allowed)
        )
        self._socket: Socket = self._context.socket(zmq.ROUTER)
        self._monitor: Socket | None = None
        self._links: dict[bytes, int] = {}
        """identity -> its connection"""
        self._bound = ""
        self.address = ""
        self._away: dict[bytes, float] = {}
        """identity whose connection closed -> when"""
        self._looked_s = monotonic_s()
        server = self._socket
        server.set(zmq.IPV6, int(is_ipv6(address)))
        server.set(zmq.MAXMSGSIZE, largest)
        server.set(zmq.SNDHWM, _ANSWERS)
        server.set(zmq.RCVTIMEO, _SLICE_MS)
        # who comes back under his name gets what is sent to it
        server.set(zmq.ROUTER_HANDOVER, 1)
        serve_anybody(server)
        if keys.own is not None:
            guard(server, keys.own)
        self._monitor = server.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        try:
            check_unused(address)
            server.bind(address)
        except EvsError:
            self.close()
            raise
        except zmq.ZMQError as reason:
            self.close()
            raise bind_error(address, reason) from None
        self._bound = address
        self.address = bytes(server.get(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode()

    def receive(self) -> tuple[Peer, list[Any]] | None:
        """The next request's sender and frames; None if none came for a moment.

        Of a request with more frames than two, one too many is kept: enough to refuse it.
        """
        now_s = monotonic_s()
        if now_s - self._looked_s > 1e-3 * _SLICE_MS:
            # also while messages come without a pause
            self._look(now_s)
        try:
            identity = self._socket.recv()
        except zmq.Again:
            self._look(monotonic_s())
            return None
        parts: list[Any] = []
        peer: Peer = (identity,)
        is_known = identity in self._links and identity not in self._away
        if not is_known:
            # the place of one that closed may be its place now: first hear of that
            self._look(now_s)
        while self._socket.get(zmq.RCVMORE):
            frame: Any
            if is_known:
                frame = self._socket.recv(zmq.NOBLOCK)
            else:
                lent = self._socket.recv(zmq.NOBLOCK, copy=False)
                frame, is_known = lent.bytes, True
                self._links[identity] = int(lent.get(zmq.SRCFD))
                self._away.pop(identity, None)
            if not parts and not frame and len(peer) == 1:
                peer = (identity, b"")
            elif len(parts) <= _MOST_PARTS:
                parts.append(frame)
        return peer, parts

    def is_waiting(self) -> bool:
        """Whether a request can be taken now."""
        return readable(self._socket)

    def answer(self, peer: Peer, parts: list[Any]) -> None:
        """Send an answer; to one who has gone, or does not read, it is dropped."""
        self._socket.send_multipart([*peer, *parts], zmq.NOBLOCK)

    def gone(self) -> list[bytes]:
        """Identities whose connection closed and did not come back; each is told once."""
        if not self._away:
            return []
        now_s = monotonic_s()
        found = [one for one, since_s in self._away.items() if now_s - since_s >= RETURN_S]
        for one in found:
            self.forget(one)
        return found

    def forget(self, identity: bytes) -> None:
        """It has said good-bye."""
        self._away.pop(identity, None)
        self._links.pop(identity, None)

    def close(self) -> None:
        """Release the port. What was answered last still travels for a moment."""
        if self._monitor is not None:
            self._socket.disable_monitor()
            self._monitor.close(linger=0)
            self._monitor = None
        self._socket.close(linger=200)
        if self._authenticator is not None:
            self._authenticator.close()
        self._context.term()
        leave(self._bound)
        self._bound = ""

    def _look(self, now_s: float) -> None:
        self._looked_s = now_s
        if self._authenticator is not None:
            self._authenticator.poll()
        while self._monitor is not None and readable(self._monitor):
            closed = int(recv_monitor_message(self._monitor, zmq.NOBLOCK)["value"])
            for identity, link in self._links.items():
                if link == closed:
                    self._away.setdefault(identity, now_s)


class ClientEnd:
    """Asks, and waits for the answer. One thread uses it."""

    def __init__(self, address: str, server_public: str, keys: Keys | None, largest: int) -> None:
        """In: address, checked; server_public, keys: of CURVE, or empty and None."""
        self._context = Context()
        self._socket: Socket = self._context.socket(zmq.DEALER)
        client = self._socket
        client.set(zmq.ROUTING_ID, b"e" + os.urandom(15))
        client.set(zmq.IPV6, int(is_ipv6(address)))
        client.set(zmq.MAXMSGSIZE, largest)
        client.set(zmq.RCVTIMEO, _SLICE_MS)
        client.set(zmq.SNDTIMEO, _SLICE_MS)
        client.set(zmq.LINGER, 0)
        notice_death(client)
        if server_public:
            present(client, server_public, keys or new_keys())
        self._handshakes = Handshakes(client)
        self._away_s: float | None = None
        client.connect(address)

    @property
    def refused(self) -> bool:
        """Whether the other end does not let us in."""
        return self._handshakes.refused

    def ask(self, parts: list[Any]) -> bool:
        """Send a request; whether it could be handed over."""
        try:
            self._socket.send_multipart(parts)
        except zmq.Again:
            return False
        return True

    def receive(self) -> list[Any] | None:
        """The frames of the next message; None if none came for a moment."""
        try:
            return self._socket.recv_multipart()
        except zmq.Again:
            self._handshakes.update()
            return None

    @property
    def gone(self) -> bool:
        """Whether the connection closed and did not come back."""
        since_s = self._handshakes.closed_s
        return since_s is not None and monotonic_s() - since_s >= RETURN_S

    def close(self, linger_s: float = 0.0) -> None:
        """Stop. What was asked last still travels for so long."""
        self._handshakes.close()
        self._socket.close(linger=int(1000 * linger_s))
        self._context.term()
