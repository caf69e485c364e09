"""The control port: one ROUTER that describes what is here and where. REQ clients work.

A request is a msgpack map {"request": NAME}; the answer is one with "ok" and either what was asked
for or "error", a line. See docs/reference/wire.md. Polled by the thread that sends; it never waits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import zmq

from evs.drivers.bus.sockets import Socket, readable, receive_parts
from evs.msgs import EvsError, MessageError, unknown
from evs.msgs.header_fields import shown
from evs.msgs.packet import packb, unpackb

PROTOCOL = 1
"""Version of this protocol; a client of another one should not guess."""

MAX_REQUEST_BYTES = 4096
"""Longest request."""

MAX_ANSWER_BYTES = 1024 * 1024
"""Longest answer."""

_MOST_AT_ONCE = 8
"""Requests answered at one poll: the others wait, the camera does not."""
_MOST_PARTS = 3
"""identity, the empty part that REQ puts in and DEALER may leave out, request"""

Answer = dict[str, Any]


class Control:
    """Answers requests by a table of functions."""

    def __init__(self, server: Socket, requests: dict[str, Callable[[], Answer]]) -> None:
        """In: server, a bound ROUTER; requests, name -> what answers it (or raises EvsError)."""
        self.answered = 0
        """Requests, the refused ones too."""
        self._server, self._requests = server, requests

    def poll(self) -> None:
        """Answer what has come, a few at a time."""
        for _ in range(_MOST_AT_ONCE):
            if not readable(self._server):
                return
            parts = receive_parts(self._server)
            envelope, request = parts[:-1], parts[-1]
            if not (1 <= len(envelope) < _MOST_PARTS and envelope[1:] in ([], [b""])):
                # nobody to answer: this is no request
                continue
            try:
                answer = packb({"ok": True, **self._answer(request)}, MAX_ANSWER_BYTES)
            except EvsError as reason:
                answer = packb({"ok": False, "error": " ".join(str(reason).split())})
            self.answered += 1
            # to a client that has gone, or does not read, it is dropped
            self._server.send_multipart([*envelope, answer], zmq.NOBLOCK)

    def _answer(self, request: bytes) -> Answer:
        name = unpackb(request, MAX_REQUEST_BYTES).get("request")
        if not isinstance(name, str):
            raise MessageError(f"field 'request' is {shown(name)}, not a name")
        if name not in self._requests:
            raise unknown("request", name[:60], self._requests)
        return self._requests[name]()
