"""LibraryRecorder: what recorders share whose libraries write a file in many places."""

from __future__ import annotations

import contextlib
import os
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from evs.drivers.files.capabilities import check_stamps, one_stream
from evs.drivers.files.formats import AnyPath, Format, by_name
from evs.drivers.files.paths import target_error
from evs.drivers.files.reserved_space import ReservedSpace
from evs.drivers.sink import Sink, SinkStoppedError
from evs.msgs import EventPacket, Events, EvsError, StreamInfo

_EVENT_BYTES = 24
"""Of an event in any of these formats, at most."""

_MESSAGE_BYTES = 4096
"""What comes with a packet's events, at most."""

_INDEX_BYTES = 64
"""What a packet adds to an index that is written at the end."""


class LibraryRecorder(Sink):
    """A Sink over a library that holds back what it is given.

    Every KEEP_US of the stream's time, all of it is handed to the system: a process that is killed
    leaves what came before that, readable. A disk that is full stops the recording; what came
    before is kept, since room for it was (room.Room). A format gives `_begin`, `_take`, `_keep` and
    `_end`; its limits are those of its entry in the table.
    """

    NAME: str
    """of the format in the table"""
    FLUSH_PERIOD_US = 100_000
    """of the stream's time; what came later a kill may lose"""
    LIBRARY_ERRORS: tuple[type[BaseException], ...] = (OSError,)
    """what the library raises where the disk does not take it"""

    def __init__(self, path: AnyPath) -> None:
        self.stream = StreamInfo(0, 0)
        self._path = Path(path)
        hidden = f".{os.getpid()}.{id(self)}.{self._path.name[-60:]}"
        self._temporary = self._path.parent / hidden
        self._format: Format = by_name(self.NAME)
        self._limits = self._format.capabilities
        self._format_name = self._format.title.partition(":")[0]
        self._room: ReservedSpace | None = None
        self._is_open = False
        self._packets = 0
        self._events = 0
        self._bytes = 0
        self._last_us = self._kept_us = -(1 << 62)
        self._failure = ""

    @abstractmethod
    def _begin(self, path: Path) -> None:
        """Create the file."""

    @abstractmethod
    def _take(self, packet: EventPacket) -> None:
        """Write one packet with events, within the format's limits."""

    @abstractmethod
    def _keep(self) -> None:
        """Hand everything to the system, so that it can be read."""

    @abstractmethod
    def _end(self) -> None:
        """End the file and let go of it."""

    def _settle(self, path: Path) -> None:
        """Put the file that `_begin(path)` created into its place; it stays open."""
        path.replace(self._path)

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file. EvsError: a stream that does not fit, no place to write."""
        self.stream = one_stream(self._path, streams, self._limits, self._format_name)
        if self._path.is_dir():
            raise target_error(self._path, IsADirectoryError())
        try:
            self._room = ReservedSpace(self._temporary.with_name(f"{self._temporary.name}.room"))
        except OSError as reason:
            raise target_error(self._path, reason) from None
        try:
            with self._faults():
                self._begin(self._temporary)
                self._keep()
                self._settle(self._temporary)
        except EvsError:
            self._discard()
            raise
        self._is_open = True

    def write(self, packet: EventPacket) -> None:
        """Take one packet. EvsError where the disk does not."""
        self._check_open()
        if len(packet.events):
            check_stamps(self._path, packet.events, self._limits, self._format_name, self.stream)
            self._check(packet.events)
            self._make_room(_EVENT_BYTES * len(packet.events))
            with self._faults():
                self._take(packet)
            self._packets += 1
            self._events += len(packet.events)
            self._last_us = int(packet.events["t"][-1])
            self._keep_by(self._last_us)

    def _keep_by(self, t_us: int) -> None:
        """The stream has come to this time: keep what was written, if it is time for that."""
        if t_us - self._kept_us >= self.FLUSH_PERIOD_US:
            with self._faults():
                self._keep()
            self._kept_us = t_us

    def close(self) -> dict[str, Any]:
        """End the file. EvsError where the disk does not take the end."""
        if self._is_open:
            self._is_open = False
            try:
                if self._room is not None:
                    self._room.close()
                with self._faults():
                    self._end()
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
        """EvsError where these events, (n,) with n > 0, cannot follow those before them."""
        first_us = int(events["t"][0])
        if first_us < self._last_us:
            raise EvsError(
                f"{self._path}: events at {first_us} us come after {self._last_us} us, and "
                f"{self._format_name} has no way back in time; record to .aedat4"
            )

    def _make_room(self, size: int) -> None:
        """Make sure that so many bytes fit on the disk. SinkStoppedError where they do not."""
        try:
            if self._room is not None:
                self._room.take(_MESSAGE_BYTES + size, _INDEX_BYTES)
        except OSError as reason:
            self._failure = (
                f"recording to {self._path} stopped after {self._events} events: "
                f"{reason.strerror}; they are kept, free some space and run again"
            )
            raise SinkStoppedError(self._failure) from None

    def _check_open(self) -> None:
        if self._failure:
            raise SinkStoppedError(self._failure)
        if not self._is_open:
            raise EvsError(f"{self._path} is not open for recording: call open first")

    @contextlib.contextmanager
    def _faults(self) -> Iterator[None]:
        """A library's error as the one line that users see."""
        try:
            yield
        except self.LIBRARY_ERRORS as reason:
            said = getattr(reason, "strerror", None) or str(reason)
            first = said.splitlines()[0] if said else type(reason).__name__
            self._failure = (
                f"recording to {self._path} stopped after {self._events} events: {first}; "
                "free some space and run again"
            )
            raise SinkStoppedError(self._failure) from None

    def _discard(self) -> None:
        """Remove what is left of the temporary files."""
        if self._room is not None:
            self._room.close()
        with contextlib.suppress(OSError):
            self._temporary.unlink()
