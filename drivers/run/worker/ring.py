"""A ring of bytes in shared memory: one process writes, one reads, nobody locks.

Both positions only grow; each has one process that writes it. What lies between them is the
writer's no more and the reader's not yet done with.
"""

from __future__ import annotations

from collections.abc import Sequence

from evs.drivers.run.worker.shared_memory import HEAD, TAIL, SharedMemory, fence

Bytes = bytes | memoryview
"""A memoryview is contiguous and of format B."""


class RingWriter:
    """The writing side."""

    def __init__(self, memory: SharedMemory) -> None:
        self._slots, self._body = memory.slots, memory.body
        self.capacity = len(self._body)
        self._head = self._slots[HEAD]
        self._tail = self._slots[TAIL]

    @property
    def free(self) -> int:
        """Bytes that may be written now."""
        self._tail = self._slots[TAIL]
        return self.capacity - (self._head - self._tail)

    def offer(self, parts: Sequence[Bytes]) -> bool:
        """Write all parts, one after the other; False and nothing of them where they do not fit."""
        size = sum(map(len, parts))
        # the reader is looked at only where its last known place does not do
        if size > self.capacity - (self._head - self._tail) and size > self.free:
            return False
        head, begin = self._head, self._head % self.capacity
        if begin + size <= self.capacity:
            body = self._body
            for part in parts:
                end = begin + len(part)
                body[begin:end] = part
                begin = end
        else:
            for part in parts:
                self._copy(part, head)
                head += len(part)
        self._publish(self._head + size)
        return True

    def pour(self, part: Bytes) -> int:
        """Write as much of it as fits now; the number of bytes."""
        count = min(len(part), self.free)
        if count:
            self._copy(part[:count], self._head)
            self._publish(self._head + count)
        return count

    def _copy(self, part: Bytes, head: int) -> None:
        begin = head % self.capacity
        first = min(len(part), self.capacity - begin)
        self._body[begin : begin + first] = part[:first] if first < len(part) else part
        if first < len(part):
            self._body[: len(part) - first] = part[first:]

    def _publish(self, head: int) -> None:
        # the bytes are there before the position says so
        fence()
        self._head = self._slots[HEAD] = head


class RingReader:
    """The reading side."""

    def __init__(self, memory: SharedMemory) -> None:
        self._slots, self._body = memory.slots, memory.body
        self.capacity = len(self._body)
        self._tail = self._slots[TAIL]

    @property
    def waiting(self) -> int:
        """Bytes that may be read now."""
        return self._slots[HEAD] - self._tail

    def take(self, target: memoryview) -> int:
        """Fill as much of target, of format B, as there is; the number of bytes."""
        count = min(len(target), self.waiting)
        if not count:
            return 0
        fence()
        begin = self._tail % self.capacity
        first = min(count, self.capacity - begin)
        target[:first] = self._body[begin : begin + first]
        if first < count:
            target[first:count] = self._body[: count - first]
        # they are copied before the writer may write over them
        fence()
        self._tail += count
        self._slots[TAIL] = self._tail
        return count
