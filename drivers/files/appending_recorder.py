"""AppendingRecorder: the base of recorders whose files are a header followed by packets."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any

from evs.drivers.files.capabilities import check_stamps, one_stream
from evs.drivers.files.formats import AnyPath, Format, by_name
from evs.drivers.files.paths import stopped_text, target_error
from evs.drivers.sink import Sink, SinkStoppedError
from evs.msgs import EventPacket, Events, EvsError, StreamInfo


class AppendingRecorder(Sink):
    """A Sink that appends each packet unbuffered: the operating system has it when write returns.

    A process that is killed leaves all packets up to then, the last perhaps torn. A full disk ends
    the recording and leaves everything before it whole. A subclass implements `_header`, `_encode`
    and, where the format has one, `_trailer`; its limits stand in the table of formats.
    """

    NAME: str
    """of the format in the table"""

    def __init__(self, path: AnyPath) -> None:
        self.stream = StreamInfo(0, 0)
        self._path = Path(path)
        self._format: Format = by_name(self.NAME)
        self._format_name = self._format.display_name
        self._file: FileIO | None = None
        self._position = 0
        self._packets = 0
        self._events = 0
        self._failure = ""

    @abstractmethod
    def _header(self, stream: StreamInfo) -> bytes:
        """The bytes at the start of the file."""

    @abstractmethod
    def _encode(self, events: Events) -> bytes:
        """The bytes of one packet's events, (n,) with n > 0, which fit into the format."""

    def _trailer(self) -> bytes:
        """The bytes at the end of the file."""
        return b""

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file and write its header.

        Args:
            streams: The only stream.

        Raises:
            EvsError: The stream does not fit into the format, or the file cannot be written.
        """
        self.stream = one_stream(self._path, streams, self._format.capabilities, self._format_name)
        self._start_file(self._path)

    def write(self, packet: EventPacket) -> None:
        """Append one packet.

        Raises:
            EvsError: The events do not fit into the format.
            SinkStoppedError: The disk is full; what was written before stays readable.
        """
        if self._failure:
            raise SinkStoppedError(self._failure)
        if len(packet.events):
            limits = self._format.capabilities
            check_stamps(self._path, packet.events, limits, self._format_name, self.stream)
            self._write_events(packet.events)

    def close(self) -> dict[str, Any]:
        """Write the trailer and close the file, even on a full disk; values for the run report."""
        if self._file is not None:
            self._finish_file()
        return {
            "type": self.NAME,
            "path": str(self._path),
            "packets": self._packets,
            "events": self._events,
            "bytes": self._position,
            "error": self._failure,
        }

    def _start_file(self, path: Path) -> None:
        """Create a file and write its header."""
        try:
            self._file = FileIO(path, "w")
        except OSError as reason:
            raise target_error(path, reason) from None
        self._position = 0
        try:
            self._append(self._header(self.stream))
        except EvsError:
            self._file.close()
            self._file = None
            raise

    def _write_events(self, events: Events) -> None:
        """Append a packet's events, which fit into the format."""
        data = self._encode(events)
        self.meter.lap("pack")
        self._append(data)
        self._packets += 1
        self._events += len(events)

    def _finish_file(self) -> None:
        """Write the trailer, unless the disk was full before; close the file."""
        assert self._file is not None
        if not self._failure:
            with suppress(EvsError):
                self._append(self._trailer())
        self._file.close()
        self._file = None

    def _append(self, data: bytes) -> None:
        """Hand all bytes to the system, or leave the file unchanged and raise SinkStoppedError."""
        if self._file is None:
            raise EvsError(f"{self._path} is not open for recording: call open first")
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as reason:
            with suppress(OSError):  # a device has no tail to cut
                os.ftruncate(self._file.fileno(), self._position)
                os.lseek(self._file.fileno(), self._position, os.SEEK_SET)
            self._failure = stopped_text(
                self._path, self._events, reason, "the events before that are readable"
            )
            raise SinkStoppedError(self._failure) from None
        self._position += len(data)
