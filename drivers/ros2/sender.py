"""Bounded queues in front of DDS writers, emptied by a thread: a slow network holds up nobody.

A writer of DDS hands its datagrams to the system at once, and waits where a slow link has filled
the socket. So the camera only leaves messages here.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Protocol

from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError

MAX_QUEUE_BYTES = 64 * 1024 * 1024
"""What may wait for one topic, however few messages that is; but always one message."""


class Write(Protocol):
    """What takes messages; middleware.Writer is one."""

    @property
    def readers(self) -> int:
        """Who would get them."""

    def write(self, data: bytes) -> bool:
        """Hand one message over; False where it is not taken. It may wait."""

    def wait(self, seconds: float) -> bool:
        """Until reliable readers have what was written; False: not in that time."""

    def close(self) -> None:
        """Nothing more is written."""


@dataclass
class Counts:
    """Of one topic."""

    sent: int = 0
    """messages that DDS took"""
    bytes: int = 0
    """in them"""
    dropped: int = 0
    """messages that were too many, or that DDS did not take"""
    elements: int = 0
    """events, samples ... in the messages sent"""
    elements_dropped: int = 0


class TopicQueue:
    """One topic: its writer, and what waits for it."""

    def __init__(self, writer: Write, depth: int) -> None:
        """In: depth, messages that may wait before the oldest are dropped."""
        self.writer, self.depth = writer, depth
        self.counts = Counts()
        self.waiting: deque[tuple[int, bytes, int]] = deque()
        """(place in the order of all topics, message, elements in it)"""
        self.waiting_bytes = 0

    def take(self) -> tuple[bytes, int]:
        """The oldest message that waits, and its elements."""
        _, data, elements = self.waiting.popleft()
        self.waiting_bytes -= len(data)
        return data, elements

    def drop(self) -> None:
        """The oldest message is lost."""
        self.counts.elements_dropped += self.take()[1]
        self.counts.dropped += 1


class Sender:
    """Sends what is put, in its order, on a thread of its own. `put` never waits for a network."""

    def __init__(self) -> None:
        self.queues: list[TopicQueue] = []
        self._changed = threading.Condition()
        self._ending = self._busy = False
        self._failure: BaseException | None = None
        self._place = 0
        self._thread = threading.Thread(target=self._run, name="ros2", daemon=True)

    def add_queue(self, writer: Write, depth: int) -> TopicQueue:
        """One more topic; before `start`."""
        self.queues.append(TopicQueue(writer, depth))
        return self.queues[-1]

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def put(self, queue: TopicQueue, data: bytes, elements: int = 1) -> None:
        """Leave one message; where the queue is full, the oldest ones are dropped and counted."""
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
        """Wait until what was put is sent (reliable: confirmed), for so long at most."""
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
                # reliable readers may still lack something
                queue.writer.wait(max(0.0, deadline_s - monotonic_s()))

    def close(self, linger_s: float) -> None:
        """Send what waits, for `linger_s` at most; what is left is dropped. Safe to call twice."""
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
        """The topic whose turn it is."""
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
                taken = queue.writer.write(data)
            except BaseException as error:  # whatever it is, the camera has to know of it
                with self._changed:
                    self._failure, self._busy = error, False
                    _count(queue.counts, False, len(data), elements)
                    self._changed.notify_all()
                return
            with self._changed:
                self._busy = False
                _count(queue.counts, taken, len(data), elements)
                self._changed.notify_all()


def _count(counts: Counts, taken: bool, size: int, elements: int) -> None:
    if taken:
        counts.sent += 1
        counts.bytes += size
        counts.elements += elements
    else:
        counts.dropped += 1
        counts.elements_dropped += elements
