"""Outbox: a bounded queue that a thread empties, so that encoding and sending cost no tick."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError

MAX_QUEUE_BYTES = 64 * 1024 * 1024
"""Most bytes that wait; a single message may be larger."""


@dataclass
class Counts:
    """Counts of an outbox."""

    sent: int = 0
    """messages"""
    bytes: int = 0
    """bytes in them"""
    dropped: int = 0
    """messages that were too many"""
    events_dropped: int = 0
    """events in them"""


@dataclass(frozen=True)
class Letter:
    """One message that waits."""

    send: Callable[[], None]
    size: int
    """bytes"""
    events: int = 0
    """events in it"""


class Outbox:
    """Sends messages in their order on a thread of its own.

    Where the queue is full, a file (`lossless`) blocks the caller, so that no data is lost; for
    clients, the oldest messages are dropped and counted.
    """

    def __init__(self, depth: int, *, lossless: bool) -> None:
        """Start the thread.

        Args:
            depth: Messages that may wait.
            lossless: Whether `put` waits for room.
        """
        self.counts = Counts()
        self._depth, self._lossless = depth, lossless
        self._changed = threading.Condition()
        self._waiting: deque[Letter] = deque()
        self._bytes = 0
        self._busy = self._ending = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="outbox", daemon=True)
        self._thread.start()

    def put(self, letter: Letter) -> None:
        """Queue one message. EvsError: an earlier one could not be sent."""
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: self._failure or not self._is_full(letter.size))
            self._check()
            while self._waiting and self._is_full(letter.size):
                oldest = self._take()
                self.counts.dropped += 1
                self.counts.events_dropped += oldest.events
            self._waiting.append(letter)
            self._bytes += letter.size
            self._changed.notify_all()

    def close(self, linger_s: float | None) -> None:
        """Send what waits, then end the thread. Safe to call twice.

        Args:
            linger_s: How long to send, s; what is left then is dropped and counted. None: for as
                long as it takes.
        """
        deadline_s = None if linger_s is None else monotonic_s() + linger_s
        with self._changed:
            while (self._waiting or self._busy) and self._failure is None:
                remaining_s = None if deadline_s is None else deadline_s - monotonic_s()
                if remaining_s is not None and remaining_s <= 0:
                    break
                self._changed.wait(remaining_s)
            while self._waiting:
                oldest = self._take()
                self.counts.dropped += 1
                self.counts.events_dropped += oldest.events
            self._ending = True
            self._changed.notify_all()
        self._thread.join(linger_s)
        self._check()

    def _check(self) -> None:
        if self._failure is not None:
            raise EvsError(f"sending failed: {self._failure}") from self._failure

    def _is_full(self, size: int) -> bool:
        full = len(self._waiting) >= self._depth or self._bytes + size > MAX_QUEUE_BYTES
        return full and bool(self._waiting)

    def _take(self) -> Letter:
        letter = self._waiting.popleft()
        self._bytes -= letter.size
        return letter

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._ending)
                if not self._waiting:
                    return
                letter = self._take()
                self._busy = True
            try:
                letter.send()
            except BaseException as error:  # any error is reported to the camera
                with self._changed:
                    self._failure, self._busy = error, False
                    self._changed.notify_all()
                return
            self.counts.sent += 1
            self.counts.bytes += letter.size
