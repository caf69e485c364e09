"""LibraryRecorder: the base of recorders whose library buffers data and writes in many places."""

from __future__ import annotations

import contextlib
import os
import weakref
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from evs.drivers.allocate import allocate
from evs.drivers.files.capabilities import check_stamps, one_stream
from evs.drivers.files.formats import AnyPath, Format, by_name
from evs.drivers.files.paths import stopped_text, target_error
from evs.drivers.sink import Sink, SinkStoppedError
from evs.msgs import EventPacket, Events, EvsError, StreamInfo

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
        # a recorder that is dropped leaves no descriptor open
        self._close = weakref.finalize(self, os.close, self._file)
        try:
            # a process that is killed leaves nothing of it
            path.unlink()
            allocate(self._file, self._kept)
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
            allocate(self._file, self._kept + more + BUFFERED_BYTES)
        finally:
            os.ftruncate(self._file, self._kept)
        self._ahead = more

    def close(self) -> None:
        """Release the space for what is written next."""
        self._close()


_EVENT_BYTES = 24
"""most bytes of an event in any of these formats"""

_MESSAGE_BYTES = 4096
"""most bytes that a packet adds to those of its events"""

_INDEX_BYTES = 64
"""bytes that a packet adds to an index that is written at the end"""


class LibraryRecorder(Sink):
    """A Sink over a library that buffers data.

    Every FLUSH_PERIOD_US of the stream's time, everything is handed to the operating system: a
    process that is killed leaves a readable file up to there. A full disk stops the recording and
    keeps what came before, since space for it was reserved. A subclass implements `_create`,
    `_write_packet`, `_sync` and `_finish`; its limits stand in the table of formats.
    """

    NAME: str
    """of the format in the table"""
    FLUSH_PERIOD_US = 100_000
    """period of `_sync` in the stream's time, us; a kill loses at most what came later"""
    LIBRARY_ERRORS: tuple[type[BaseException], ...] = (OSError,)
    """what the library raises when the disk is full"""

    def __init__(self, path: AnyPath) -> None:
        self.stream = StreamInfo(0, 0)
        self._path = Path(path)
        hidden = f".{os.getpid()}.{id(self)}.{self._path.name[-60:]}"
        self._temporary = self._path.parent / hidden
        self._format: Format = by_name(self.NAME)
        self._limits = self._format.capabilities
        self._format_name = self._format.title.partition(":")[0]
        self._reserved: ReservedSpace | None = None
        self._is_open = False
        self._packets = 0
        self._events = 0
        self._bytes = 0
        self._last_us = self._synced_us = -(1 << 62)
        self._failure = ""

    @abstractmethod
    def _create(self, path: Path) -> None:
        """Create the file."""

    @abstractmethod
    def _write_packet(self, packet: EventPacket) -> None:
        """Write one packet that has events and fits into the format."""

    @abstractmethod
    def _sync(self) -> None:
        """Hand everything to the operating system, so that the file is readable up to here."""

    @abstractmethod
    def _finish(self) -> None:
        """Write the end of the file and close it."""

    def _move_into_place(self, path: Path) -> None:
        """Move the file that `_create(path)` created to its final name; it stays open."""
        path.replace(self._path)

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file.

        Args:
            streams: The only stream.

        Raises:
            EvsError: The stream does not fit into the format, or the file cannot be written.
        """
        self.stream = one_stream(self._path, streams, self._limits, self._format_name)
        try:
            if self._path.is_dir():
                raise IsADirectoryError
            self._reserved = ReservedSpace(
                self._temporary.with_name(f"{self._temporary.name}.room")
            )
        except OSError as reason:
            raise target_error(self._path, reason) from None
        try:
            with self._library_errors():
                self._create(self._temporary)
                self._sync()
                self._move_into_place(self._temporary)
        except EvsError:
            self._discard()
            raise
        self._is_open = True

    def write(self, packet: EventPacket) -> None:
        """Write one packet.

        Raises:
            EvsError: The events do not fit into the format.
            SinkStoppedError: The disk is full.
        """
        self._check_open()
        if len(packet.events):
            check_stamps(self._path, packet.events, self._limits, self._format_name, self.stream)
            self._check(packet.events)
            self._reserve(_EVENT_BYTES * len(packet.events))
            with self._library_errors():
                self._write_packet(packet)
            self._packets += 1
            self._events += len(packet.events)
            self._last_us = int(packet.events["t"][-1])
            self._sync_if_due(self._last_us)

    def _sync_if_due(self, t_us: int) -> None:
        """Sync if a period has passed when the stream reaches this time."""
        if t_us - self._synced_us >= self.FLUSH_PERIOD_US:
            with self._library_errors():
                self._sync()
            self._synced_us = t_us

    def close(self) -> dict[str, Any]:
        """Write the end of the file and close it.

        Returns:
            Plain values for the run report.

        Raises:
            SinkStoppedError: The disk is full.
        """
        if self._is_open:
            self._is_open = False
            try:
                if self._reserved is not None:
                    self._reserved.close()
                with self._library_errors():
                    self._finish()
                    self._bytes = self._path.stat().st_size
            finally:
                self._discard()
        return {
            "type": self.NAME,
            "path": str(self._path),
            "packets": self._packets,
            "events": self._events,
            "bytes": self._bytes,
            "error": self._failure,
        }

    def _check(self, events: Events) -> None:
        """EvsError where these events, (n,) with n > 0, may not follow those before them."""
        first_us = int(events["t"][0])
        if first_us < self._last_us:
            raise EvsError(
                f"{self._path}: events at {first_us} us come after {self._last_us} us, and "
                f"{self._format_name} has no way back in time; record to .aedat4"
            )

    def _reserve(self, size: int) -> None:
        """Reserve bytes on the disk. Raises SinkStoppedError without space."""
        try:
            if self._reserved is not None:
                self._reserved.reserve(_MESSAGE_BYTES + size, _INDEX_BYTES)
        except OSError as reason:
            self._failure = stopped_text(self._path, self._events, reason, "they are kept")
            raise SinkStoppedError(self._failure) from None

    def _check_open(self) -> None:
        if self._failure:
            raise SinkStoppedError(self._failure)
        if not self._is_open:
            raise EvsError(f"{self._path} is not open for recording: call open first")

    @contextlib.contextmanager
    def _library_errors(self) -> Iterator[None]:
        """Turn an error of the library into the one line that users see."""
        try:
            yield
        except self.LIBRARY_ERRORS as reason:
            text = getattr(reason, "strerror", None) or str(reason)
            first = text.splitlines()[0] if text else type(reason).__name__
            self._failure = (
                f"recording to {self._path} stopped after {self._events} events: {first}; "
                "free some space and run again"
            )
            raise SinkStoppedError(self._failure) from None

    def _discard(self) -> None:
        """Remove what is left of the temporary files."""
        if self._reserved is not None:
            self._reserved.close()
        with contextlib.suppress(OSError):
            self._temporary.unlink()
