"""Shared memory without a name: two processes see it, and it goes when both have gone."""

from __future__ import annotations

import mmap
import os
import tempfile
import threading
from types import TracebackType

from evs.msgs import EvsError

CONTROL_BYTES = 4096
"""Before the ring: its positions and everything else that both sides read at any time."""

HEAD, TAIL, SLEEPS, MESSAGES, STOP = 0, 8, 16, 24, 32
"""Slots of int64, each on a cache line of its own: bytes written so far; bytes read; whether the
reader has to be woken; how many messages it has sent; whether it wants the run to end."""

POSE, TRUTH, LIGHT = 512, 768, 1024
"""Where a byte for each camera says whether the sink wants these of it."""

MAX_CAMERAS = TRUTH - POSE

_FENCE = threading.Lock()


def fence() -> None:
    """What this process wrote before is seen before what it writes or reads after.

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
        """In: number, a file of `size` bytes, which this object closes."""
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
        """Zeroed memory. EvsError where the machine has not so much."""
        size = CONTROL_BYTES + ring_bytes
        # the system kills a process that asks for all of its memory
        most = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 4
        if size > most:
            raise EvsError(
                f"{size / 1e6:.0f} MB of memory for a sink aside are over a quarter of this "
                f"machine's; give {most // 1_000_000} or less as its aside_mb"
            )
        number = -1
        try:
            number = _nameless()
            # allocated now: a page that is missing later would kill the writer
            os.posix_fallocate(number, 0, size)
            return cls(number, size)
        except OSError as reason:
            if number >= 0:
                os.close(number)
            raise EvsError(
                f"no {size / 1e6:.0f} MB of memory for a sink aside: {reason.strerror}; "
                "give less as its aside_mb, or leave aside out"
            ) from None

    @classmethod
    def attach(cls, number: int) -> SharedMemory:
        """The same memory in the process that inherited the file."""
        return cls(number, os.fstat(number).st_size)

    def close(self) -> None:
        """Give it back. Safe to call twice."""
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
    """The number of a new file that no folder lists."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("evs-aside")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
