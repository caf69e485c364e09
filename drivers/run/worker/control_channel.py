"""Lines of JSON over a socket between the two processes: setup, errors and the sink's report."""

from __future__ import annotations

import json
import socket
from typing import Any

_RECEIVE_BYTES = 65536


class ControlChannel:
    """One end. Single bytes that only wake the other process are sent beside it, see `link`."""

    def __init__(self, link: socket.socket) -> None:
        self.link = link
        self.closed = False
        """The other end sends nothing more."""
        self._partial = b""
        self._received: list[dict[str, Any]] = []

    def send(self, **message: Any) -> None:
        """Send one line. OSError: the other end is gone."""
        self.link.sendall(json.dumps(message, default=_plain).encode() + b"\n")

    def receive(self) -> dict[str, Any] | None:
        """Wait for the next line; None once the other end sends nothing more."""
        while not self._received and not self.closed:
            self._read(0)
        return self._received.pop(0) if self._received else None

    def poll(self) -> list[dict[str, Any]]:
        """Return the lines that have come, without waiting."""
        while not self.closed and self._read(socket.MSG_DONTWAIT):
            pass
        received, self._received = self._received, []
        return received

    def _read(self, flags: int) -> bool:
        try:
            data = self.link.recv(_RECEIVE_BYTES, flags)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        if not data:
            self.closed = True
        *whole, self._partial = (self._partial + data).split(b"\n")
        self._received += [json.loads(line) for line in whole]
        return bool(data)


def _plain(value: Any) -> Any:
    """numpy's scalars and arrays as plain values; anything else as its text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
