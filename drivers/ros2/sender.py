"""Bounded queues in front of DDS writers, emptied by a thread, so that no network slows a camera.

A DDS writer sends its datagrams at once, and blocks where a slow link has filled the socket. The
camera therefore only queues messages.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Protocol

from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError

MAX_QUEUE_BYTES = 64 * 1024 * 1024
"""Most bytes that wait for one topic; a single message may be larger."""


class Write(Protocol):
    """A writer of messages, such as middleware.Writer."""

    @property
    def readers(self) -> int:
        """Number of readers."""

    def write(self, data: bytes) -> bool:
        """Write one message; return False where it is not taken. It may block."""

    def wait(self, seconds: float) -> bool:
        """Wait until reliable readers have all messages; return False on a timeout."""

    def close(self) -> None:
        """Leave the topic."""


@dataclass
class Counts:
    """Counts of one topic."""

    sent: int = 0
    """messages that DDS took"""
    bytes: int = 0
    """bytes in them"""
    dropped: int = 0
    """messages that were too many, or that DDS did not take"""
    elements: int = 0
    """events, samples ... in the messages sent"""
    elements_dropped: int = 0


class TopicQueue:
    """One topic: its writer, and what waits for it."""

    def __init__(self, writer: Write, depth: int) -> None:
        """Start empty; `depth` is how many messages may wait before the oldest are dropped."""
        self.writer, self.depth = writer, depth
        self.counts = Counts()
        self.waiting: deque[tuple[int, bytes, int]] = deque()
        """(number in the order of all topics, message, elements in it)"""
        self.waiting_bytes = 0

    def take(self) -> tuple[bytes, int]:
        """Remove the oldest message; return it and its number of elements."""
        _, data, elements = self.waiting.popleft()
        self.waiting_bytes -= len(data)
        return data, elements

    def drop(self) -> None:
        """Drop the oldest message and count it."""
        self.counts.elements_dropped += self.take()[1]
        self.counts.dropped += 1


class Sender:
    """Sends messages in their order on a thread of its own; `put` never waits for a network."""

    def __init__(self) -> None:
        self.queues: list[TopicQueue] = []
        self._changed = threading.Condition()
        self._ending = self._busy = False
        self._failure: BaseException | None = None
        self._place = 0
        self._thread = threading.Thread(target=self._run, name="ros2", daemon=True)

    def add_queue(self, writer: Write, depth: int) -> TopicQueue:
        """Add a topic, before `start`."""
        self.queues.append(TopicQueue(writer, depth))
        return self.queues[-1]

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def put(self, queue: TopicQueue, data: bytes, elements: int = 1) -> None:
        """Queue one message; where the queue is full, the oldest ones are dropped and counted."""
        with self._changed:
            if self._failure is not None:
                raise EvsError(f"sending to ROS 2 failed: {self._failure}") from self._failure
            queue.waiting.append((self._place, data, elements))
            queue.waiting_bytes += len(data)
            self._place += 1
            while len(queue.waiting) > queue.depth or (
                queue.waiting_bytes > MAX_QUEUE_BYTES and len(queue.waiting) > 1
            ):
                queue.drop()
            self._changed.notify_all()

    def flush(self, seconds: float) -> None:
        """Wait until all messages are sent (reliable: confirmed), or for a number of seconds."""
        deadline_s = monotonic_s() + seconds
        if not self._thread.is_alive():
            return
        with self._changed:
            while (self._busy or self._next()) and self._failure is None:
                remaining_s = deadline_s - monotonic_s()
                if remaining_s <= 0:
                    return
                self._changed.wait(remaining_s)
        for queue in self.queues:
            if queue.counts.sent:
                # reliable readers may not have everything yet
                queue.writer.wait(max(0.0, deadline_s - monotonic_s()))

    def close(self, linger_s: float) -> None:
        """Send what waits for at most `linger_s`, then drop the rest. Safe to call twice."""
        self.flush(linger_s)
        with self._changed:
            self._ending = True
            for queue in self.queues:
                while queue.waiting:
                    queue.drop()
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(max(linger_s, 1.0))

    def _next(self) -> TopicQueue | None:
        """The queue with the oldest message; None if nothing waits."""
        waiting = (queue for queue in self.queues if queue.waiting)
        return min(waiting, key=lambda queue: queue.waiting[0][0], default=None)

    def _run(self) -> None:
        while True:
            with self._changed:
                while (queue := self._next()) is None:
                    if self._ending:
                        return
                    self._changed.wait()
                data, elements = queue.take()
                self._busy = True
            try:
                accepted = queue.writer.write(data)
            except BaseException as error:  # any error is reported to the camera
                with self._changed:
                    self._failure, self._busy = error, False
                    _count(queue.counts, False, len(data), elements)
                    self._changed.notify_all()
                return
            with self._changed:
                self._busy = False
                _count(queue.counts, accepted, len(data), elements)
                self._changed.notify_all()


def _count(counts: Counts, accepted: bool, size: int, elements: int) -> None:
    if accepted:
        counts.sent += 1
        counts.bytes += size
        counts.elements += elements
    else:
        counts.dropped += 1
        counts.elements_dropped += elements
