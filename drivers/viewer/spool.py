"""Spool: a file that another library writes through us, so that a full disk is ours to handle."""

from __future__ import annotations

import os
import threading
from pathlib import Path

_CHUNK_BYTES = 1 << 20


class Spool:
    """What is written to `inlet` lands in the file, until the disk takes no more.

    Rerun's own writer waits for ever, and its user with it, where a file of its own cannot grow.
    Here the rest is thrown away, and `failure` says why.
    """

    def __init__(self, path: Path) -> None:
        """Create the file. OSError: no place for it."""
        self.failure = ""
        """what the system said when it took no more; empty: all is well"""
        self._file = path.open("wb", buffering=0)
        self._outlet, self._inlet = os.pipe()
        self._thread = threading.Thread(target=self._pump, name=f"spool {path.name}", daemon=True)
        self._thread.start()

    @property
    def inlet(self) -> str:
        """The path to open for writing, once, before `begun`."""
        return f"/dev/fd/{self._inlet}"

    def begun(self) -> None:
        """It is open: the file ends when the other side closes it."""
        os.close(self._inlet)

    def join(self) -> None:
        """Until everything is in the file, or thrown away."""
        self._thread.join()

    def _pump(self) -> None:
        with self._file:
            while data := os.read(self._outlet, _CHUNK_BYTES):
                if self.failure:
                    continue
                rest = memoryview(data)
                try:
                    while rest:
                        rest = rest[self._file.write(rest) :]
                except OSError as reason:
                    self.failure = reason.strerror or str(reason)
        os.close(self._outlet)
