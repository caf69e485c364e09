"""The gate of a publisher with keys: which clients come in. ZeroMQ asks it at each handshake.

ZAP (RFC 27): version, request id, domain, address, identity, mechanism, the client's public key in;
version, request id, status code, status text, user id, metadata out.
"""

from __future__ import annotations

import zmq
from zmq.utils import z85

from evs.drivers.bus.sockets import Context, Socket, readable

_ENDPOINT = "inproc://zeromq.zap.01"
_MOST_AT_ONCE = 16
"""Handshakes answered at one poll: a crowd of clients waits, the camera does not."""


class ZapAuthenticator:
    """Answers for all sockets of one context. Polled by the thread that sends."""

    def __init__(self, context: Context, allowed: frozenset[str]) -> None:
        """In: allowed, public keys; none: whoever knows the publisher's own public key."""
        self.refused = 0
        """Handshakes that were turned away."""
        self._allowed = {z85.decode(key.encode()) for key in allowed}
        self.socket: Socket = context.socket(zmq.REP)
        self.socket.bind(_ENDPOINT)

    def poll(self) -> None:
        """Answer whoever asks."""
        for _ in range(_MOST_AT_ONCE):
            if not readable(self.socket):
                return
            version, request, *asked = self.socket.recv_multipart(zmq.NOBLOCK)
            welcome = asked[3:4] == [b"CURVE"] and (not self._allowed or asked[4] in self._allowed)
            self.refused += not welcome
            answer = (b"200", b"OK") if welcome else (b"400", b"this key may not come in")
            self.socket.send_multipart([version, request, *answer, b"", b""], zmq.NOBLOCK)

    def close(self) -> None:
        """Nobody comes in any more."""
        self.socket.close(linger=0)
