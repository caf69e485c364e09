"""Memory that two processes share: some control values and a ring of bytes.

The memory has no name and is freed once both processes have gone. One process writes to the ring,
one reads, nobody locks: both positions only grow, and each has one process that writes it. The
bytes between them are written and not read yet.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import threading
from collections.abc import Sequence
from types import TracebackType

from evs.drivers.allocate import allocate
from evs.msgs import EvsError

CONTROL_BYTES = 4096
"""Before the ring: its positions and everything else that both sides read at any time."""

HEAD, TAIL, SLEEPS, MESSAGES, STOP = 0, 8, 16, 24, 32
"""Slots of int64, each on a cache line of its own: bytes written so far; bytes read; whether the
reader has to be woken; how many messages it has sent; whether it wants the run to end."""

POSE, TRUTH, LIGHT = 512, 768, 1024
"""Where a byte for each camera is set if the sink wants its pose, ground truth or light."""

MAX_CAMERAS = TRUTH - POSE

_FENCE = threading.Lock()


def fence() -> None:
    """Order memory: what this process wrote before is seen before what it writes or reads after.

    Taking a lock is a full barrier on x86; on weaker machines two in a row are one: nothing passes
    the release of the first downwards or the taking of the second upwards.
    """
    with _FENCE:
        pass
    with _FENCE:
        pass


class SharedMemory:
    """CONTROL_BYTES and a ring. Made by one process, attached by its file number in the other."""

    def __init__(self, number: int, size: int) -> None:
        """Map a file.

        Args:
            number: Of the file, which this object closes.
            size: Of the file, bytes.
        """
        self.number = number
        populate = getattr(mmap, "MAP_POPULATE", 0)
        # every page is there from the start: the first round costs no faults
        self._map = mmap.mmap(number, size, flags=mmap.MAP_SHARED | populate)
        whole = memoryview(self._map)
        self.slots = whole[:CONTROL_BYTES].cast("q")
        self.flags = whole[:CONTROL_BYTES]
        self.body = whole[CONTROL_BYTES:]
        self._views = (whole, self.slots, self.flags, self.body)

    @classmethod
    def make(cls, ring_bytes: int) -> SharedMemory:
        """Return zeroed memory. EvsError where the machine has not enough."""
        size = CONTROL_BYTES + ring_bytes
        # the system kills a process that asks for all of its memory
        most = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 4
        if size > most:
            raise EvsError(
                f"{size / 1e6:.0f} MB of memory for a worker sink are over a quarter of this "
                f"machine's; give {most // 1_000_000} or less as its worker_mb"
            )
        number = -1
        try:
            number = _nameless()
            # allocated now: a page that is missing later would kill the writer
            allocate(number, size)
            return cls(number, size)
        except OSError as reason:
            if number >= 0:
                os.close(number)
            raise EvsError(
                f"no {size / 1e6:.0f} MB of memory for a worker sink: {reason.strerror}; "
                "give less as its worker_mb, or leave worker out"
            ) from None

    @classmethod
    def attach(cls, number: int) -> SharedMemory:
        """Return the same memory, in the process that inherited the file."""
        return cls(number, os.fstat(number).st_size)

    def close(self) -> None:
        """Free it. Safe to call twice."""
        if self.number >= 0:
            for view in self._views:
                view.release()
            self._map.close()
            os.close(self.number)
            self.number = -1

    def __enter__(self) -> SharedMemory:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _nameless() -> int:
    """Return the number of a new file that no folder lists."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("evs-worker")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


Bytes = bytes | memoryview
"""A memoryview is contiguous and of format B."""


class RingWriter:
    """The writing end of the ring."""

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
        """Write all parts in their order; if they do not fit, write nothing, return False."""
        size = sum(map(len, parts))
        # read the other end's position only where the last known one does not suffice
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
        """Write as much of `part` as fits now; return the number of bytes."""
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
    """The reading end of the ring."""

    def __init__(self, memory: SharedMemory) -> None:
        self._slots, self._body = memory.slots, memory.body
        self.capacity = len(self._body)
        self._tail = self._slots[TAIL]

    @property
    def waiting(self) -> int:
        """Bytes that may be read now."""
        return self._slots[HEAD] - self._tail

    def take(self, target: memoryview) -> int:
        """Read what there is into `target` (format B), up to its size; return the bytes read."""
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
