"""Disk space that is reserved in advance, so that what a library buffers can still be written."""

from __future__ import annotations

import os
from pathlib import Path

RESERVED_BYTES = 2 << 20
"""reserved from the start, and released for what ends a file"""

BUFFERED_BYTES = 6 << 20
"""what a library may have received but not written yet: a bag's chunk, HDF5's caches"""

STEP_BYTES = 2 << 20
"""reserved ahead, so that not every packet needs a system call"""


class ReservedSpace:
    """A file without a name and content that grows to reserve space and is deleted at the end.

    Libraries that write a file in many places leave it unreadable when the disk is full. They are
    therefore called only while there is space for everything that they have been given.
    """

    def __init__(self, path: Path) -> None:
        """Reserve the first bytes.

        Args:
            path: Where the file may be created; its name is free again at once.

        Raises:
            OSError: There is no space, or no permission.
        """
        self._kept = RESERVED_BYTES
        self._ahead = 0
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            # a process that is killed leaves nothing of it
            path.unlink()
            os.posix_fallocate(self._file, 0, self._kept)
        except OSError:
            self.close()
            raise

    def reserve(self, needed: int, later: int) -> None:
        """Make sure of `needed` bytes now and `later` bytes at the end. OSError: no space."""
        if needed + later > self._ahead:
            try:
                self._allocate(needed + later + STEP_BYTES)
            except OSError:
                self._allocate(needed + later)
        self._ahead -= needed + later
        self._kept += later

    def _allocate(self, more: int) -> None:
        try:
            os.posix_fallocate(self._file, 0, self._kept + more + BUFFERED_BYTES)
        finally:
            os.ftruncate(self._file, self._kept)
        self._ahead = more

    def close(self) -> None:
        """Release the space for what is written next."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
