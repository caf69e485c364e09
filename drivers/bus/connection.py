"""Warnings for a person when the connection to a publisher is cut, and when it is back."""

from __future__ import annotations

from collections.abc import Callable

from evs.drivers.bus.subscriber import Subscription


class Connection:
    """Watches a subscription from which others receive."""

    def __init__(self, stream: Subscription, warn: Callable[[str], None]) -> None:
        """Watch `stream`; warn(line) is called once for each change."""
        self._stream, self._warn = stream, warn
        self._was_there = False
        self._is_cut = False

    def update(self) -> None:
        """Warn of what has changed since the last call."""
        address, status = self._stream.address, self._stream.status
        there = self._stream.connected
        if self._was_there and not there and not (status is not None and status.end):
            self._is_cut = True
            self._warn(f"the connection to {address} is cut: waiting for it (Ctrl-C ends)")
        elif there and self._is_cut:
            self._is_cut = False
            self._warn(f"the connection to {address} is there again")
        self._was_there = there
