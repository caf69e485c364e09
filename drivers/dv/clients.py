"""One listener of a stream: its own bounded queue, which loses the oldest messages when it is slow.

No method here ever waits.
"""

from __future__ import annotations

import socket
from collections import deque
from dataclasses import dataclass

MAX_QUEUE_BYTES = 64 * 1024 * 1024
"""What may wait for one client, however few messages that is; but always one message."""

PATIENCE_S = 300.0
"""How long a client may take nothing at all before it counts as gone: a cut cable says nothing,
and somebody may be looking at his program in a debugger."""

_MOST_PATIENCE_S = 5 * 32767.0
"""the system counts no longer pauses"""
_RECEIVE_BYTES = 4096


@dataclass
class Sent:
    """Counts over all clients of a stream."""

    packets: int = 0
    """messages that the system took whole"""
    bytes: int = 0
    packets_dropped: int = 0
    elements_dropped: int = 0
    """events, frames, samples or triggers in them"""


class Client:
    """A connection whose other end only listens."""

    def __init__(
        self,
        link: socket.socket,
        header: bytes,
        queue: int,
        sent: Sent,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """In: link, connected; header, what it gets first; queue, messages that may wait."""
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        _notice_death(link, patience_s)
        self.link = link
        self._queue, self._sent = queue, sent
        # what was begun must be ended, or the other end loses its place in the stream
        self._begun = memoryview(header)
        self._begun_elements = -1
        """-1: it is the header"""
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._waiting_bytes = 0

    @property
    def is_waiting(self) -> bool:
        """Whether something is left to send."""
        return bool(self._begun or self._waiting)

    def put(self, message: bytes, elements: int) -> None:
        """Queue one message; where the queue is full, the oldest ones are dropped."""
        self._waiting.append((message, elements))
        self._waiting_bytes += len(message)
        while len(self._waiting) > self._queue or (
            self._waiting_bytes > MAX_QUEUE_BYTES and len(self._waiting) > 1
        ):
            oldest, lost = self._waiting.popleft()
            self._waiting_bytes -= len(oldest)
            self._sent.packets_dropped += 1
            self._sent.elements_dropped += lost

    def flush(self) -> bool:
        """Send what the system takes; False where nobody is there any more."""
        try:
            while self._begun or self._begin():
                done = self.link.send(self._begun)
                self._sent.bytes += done
                self._begun = self._begun[done:]
                if not self._begun:
                    self._sent.packets += self._begun_elements >= 0
        except BlockingIOError:
            return True
        except OSError:
            return False
        return True

    def read(self) -> bool:
        """Discard what it sends, which means nothing; return False once it has left."""
        try:
            return bool(self.link.recv(_RECEIVE_BYTES))
        except BlockingIOError:
            return True
        except OSError:
            return False

    def close(self) -> None:
        """Hang up; what still waits is dropped and counted."""
        if self._begun and self._begun_elements >= 0:
            self._waiting.append((b"", self._begun_elements))
        self._sent.packets_dropped += len(self._waiting)
        self._sent.elements_dropped += sum(elements for _, elements in self._waiting)
        self._waiting.clear()
        self._begun = memoryview(b"")
        self.link.close()

    def _begin(self) -> bool:
        if not self._waiting:
            return False
        message, self._begun_elements = self._waiting.popleft()
        self._waiting_bytes -= len(message)
        self._begun = memoryview(message)
        return True


def _notice_death(link: socket.socket, patience_s: float) -> None:
    """Let the system find out that nobody is there any more: by itself it takes hours, or never."""
    link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    patience_s = min(patience_s, _MOST_PATIENCE_S)
    pause_s = max(1, round(patience_s / 5))
    for name, value in (
        # nothing to send: ask after a pause, then four times
        ("TCP_KEEPIDLE", pause_s),
        ("TCP_KEEPINTVL", pause_s),
        ("TCP_KEEPCNT", 4),
        # something to send, and nobody takes it
        ("TCP_USER_TIMEOUT", round(1000 * patience_s)),
    ):
        # not every system has every one
        if hasattr(socket, name):
            link.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
