"""Lines of JSON over a socket between the two processes: everything that is said rarely."""

from __future__ import annotations

import json
import socket
from typing import Any

_RECEIVE_BYTES = 65536


class Lines:
    """One end. What is no line, as a byte that only wakes, never gets here."""

    def __init__(self, link: socket.socket) -> None:
        self.link = link
        self.gone = False
        """The other end says nothing more."""
        self._coming = b""
        self._heard: list[dict[str, Any]] = []

    def say(self, **said: Any) -> None:
        """Send one line. OSError: nobody is there."""
        self.link.sendall(json.dumps(said, default=_plain).encode() + b"\n")

    def next(self) -> dict[str, Any] | None:
        """The next line, waited for; None once the other end says nothing more."""
        while not self._heard and not self.gone:
            self._receive(0)
        return self._heard.pop(0) if self._heard else None

    def heard(self) -> list[dict[str, Any]]:
        """The lines that have come, without waiting."""
        while not self.gone and self._receive(socket.MSG_DONTWAIT):
            pass
        heard, self._heard = self._heard, []
        return heard

    def _receive(self, flags: int) -> bool:
        try:
            data = self.link.recv(_RECEIVE_BYTES, flags)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        if not data:
            self.gone = True
        *whole, self._coming = (self._coming + data).split(b"\n")
        self._heard += [json.loads(line) for line in whole]
        return bool(data)


def _plain(value: Any) -> Any:
    """numpy's scalars and arrays as plain values; anything else as its text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
