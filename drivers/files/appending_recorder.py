"""AppendingRecorder: what recorders share whose files are a header and then packet after packet."""

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
from evs.drivers.files.paths import target_error
from evs.drivers.sink import Sink, SinkStoppedError
from evs.msgs import EventPacket, Events, EvsError, StreamInfo


class AppendingRecorder(Sink):
    """A Sink that appends each packet's bytes, unbuffered: with the system when write returns.

    A process that is killed leaves all packets until then, the last perhaps torn; a disk that is
    full ends the recording with everything before it whole. A format gives `_header` and `_encoded`
    and, where it has more to say, `_ending`. Its limits are those of its entry in the table.
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
        """What the file begins with."""

    @abstractmethod
    def _encoded(self, events: Events) -> bytes:
        """The bytes of one packet's events, (n,) with n > 0, within the format's limits."""

    def _ending(self) -> bytes:
        """What the file ends with."""
        return b""

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file and write its header. EvsError: a stream that does not fit, no place."""
        self.stream = one_stream(self._path, streams, self._format.capabilities, self._format_name)
        self._start(self._path)

    def write(self, packet: EventPacket) -> None:
        """Append one packet. SinkStoppedError where the disk does not take it; the rest stays."""
        if self._failure:
            raise SinkStoppedError(self._failure)
        if len(packet.events):
            limits = self._format.capabilities
            check_stamps(self._path, packet.events, limits, self._format_name, self.stream)
            self._put(packet.events)

    def close(self) -> dict[str, Any]:
        """End the file and let go of it. Never raises for a disk that is full."""
        if self._file is not None:
            self._finish()
        return {
            "type": self.NAME,
            "path": str(self._path),
            "packets": self._packets,
            "events": self._events,
            "bytes": self._position,
            "error": self._failure,
        }

    def _start(self, path: Path) -> None:
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

    def _put(self, events: Events) -> None:
        """Append a packet's events, which fit."""
        data = self._encoded(events)
        self.meter.lap("pack")
        self._append(data)
        self._packets += 1
        self._events += len(events)

    def _finish(self) -> None:
        """Write the ending, unless the disk had no room before; close the file."""
        assert self._file is not None
        if not self._failure:
            with suppress(EvsError):
                self._append(self._ending())
        self._file.close()
        self._file = None

    def _append(self, data: bytes) -> None:
        """Hand all bytes to the system, or leave the file as it was and raise EvsError."""
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
            self._failure = (
                f"recording to {self._path} stopped after {self._events} events: "
                f"{reason.strerror}; what was recorded is readable, free some space and run again"
            )
            raise SinkStoppedError(self._failure) from None
        self._position += len(data)
