"""Room: space on a disk that is kept free, so that what a library holds back can be written."""

from __future__ import annotations

import os
from pathlib import Path

RESERVED_BYTES = 2 << 20
"""Taken from the begin, and given back for what ends a file."""

HELD_BACK_BYTES = 6 << 20
"""What a library was given, but has not written yet: a bag's chunk, HDF5's caches."""

STEP_BYTES = 2 << 20
"""So much is asked for ahead, so that not every packet has to ask the system."""


class ReservedSpace:
    """A file of nothing, without a name, which grows to ask for room and goes before the end.

    Libraries that write a file in many places leave it unreadable where the disk is full; so they
    are only called when there is room for everything that they have been given.
    """

    def __init__(self, path: Path) -> None:
        """In: where the file may come about; OSError if there is no room for it."""
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

    def take(self, needed: int, later: int) -> None:
        """Room for `needed` bytes now, and `later` at the end. OSError where there is none."""
        if needed + later > self._ahead:
            try:
                self._ask(needed + later + STEP_BYTES)
            except OSError:
                self._ask(needed + later)
        self._ahead -= needed + later
        self._kept += later

    def _ask(self, more: int) -> None:
        try:
            os.posix_fallocate(self._file, 0, self._kept + more + HELD_BACK_BYTES)
        finally:
            os.ftruncate(self._file, self._kept)
        self._ahead = more

    def close(self) -> None:
        """Give the room back; what is written next may fill it."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
