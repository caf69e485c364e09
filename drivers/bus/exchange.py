"""Requests and answers between processes: the two ends of lock-step, without its messages.

The server is a ROUTER with any number of clients (REQ ones, too), a client a DEALER. Both notice a
connection that closes; one that comes back within RETURN_S does not count as closed.
"""

from __future__ import annotations

import os
from typing import Any

import zmq
from zmq.utils.monitor import recv_monitor_message

from evs.drivers.bus.address import check_unused, is_ipv6, leave
from evs.drivers.bus.curve_keys import Keys, ZapAuthenticator, guard, new_keys, present
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
"""How long a closed connection may take to come back before its other end counts as gone, s."""

_SLICE_MS = 50
"""Longest time between two checks of handshakes, closed connections and signals."""
_MOST_PARTS = 2
"""Frames of a request: header and body."""
_ANSWERS = 64
"""Answers held for a client that does not read them."""

Peer = tuple[bytes, ...]
"""Where a request came from and its answer goes to: identity, and REQ's empty frame."""


class ServerEnd:
    """Receives requests and sends answers. One thread uses it."""

    def __init__(self, address: str, keys: ServerKeys, largest: int) -> None:
        """Bind.

        Args:
            address: Checked by `bindable`.
            keys: Of the server.
            largest: Bytes of a frame.

        Raises:
            EvsError: The address cannot be bound.
        """
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
        # a client that comes back under its name gets what is sent to it
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
        """Return the next request's sender and frames; None if none came for a moment.

        Of a request with more frames than two, one too many is returned: enough to refuse it.
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
            # its connection may have the number of one that closed: learn of that first
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
        """Return whether a request can be read now."""
        return readable(self._socket)

    def answer(self, peer: Peer, parts: list[Any]) -> None:
        """Send an answer; it is dropped if the client has gone, or does not read."""
        self._socket.send_multipart([*peer, *parts], zmq.NOBLOCK)

    def gone(self) -> list[bytes]:
        """Return identities whose connection closed and did not come back, each once."""
        if not self._away:
            return []
        now_s = monotonic_s()
        found = [one for one, since_s in self._away.items() if now_s - since_s >= RETURN_S]
        for one in found:
            self.forget(one)
        return found

    def forget(self, identity: bytes) -> None:
        """Forget a client that has left."""
        self._away.pop(identity, None)
        self._links.pop(identity, None)

    def close(self) -> None:
        """Release the port. The last answers are still sent, for a moment."""
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
    """Sends requests and receives answers. One thread uses it."""

    def __init__(self, address: str, server_public: str, keys: Keys | None, largest: int) -> None:
        """Connect.

        Args:
            address: Checked by `connectable`.
            server_public: The server's public key; empty: no encryption.
            keys: Of this client; None: new ones.
            largest: Bytes of a frame.
        """
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
        """Whether the server refuses us."""
        return self._handshakes.refused

    def ask(self, parts: list[Any]) -> bool:
        """Send a request; return whether it could be queued."""
        try:
            self._socket.send_multipart(parts)
        except zmq.Again:
            return False
        return True

    def receive(self) -> list[Any] | None:
        """Return the frames of the next message; None if none came for a moment."""
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
        """Disconnect. The last request is still sent, for `linger_s`."""
        self._handshakes.close()
        self._socket.close(linger=int(1000 * linger_s))
        self._context.term()
