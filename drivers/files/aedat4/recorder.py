"""Aedat4Recorder: one camera's packets into an AEDAT4 file that survives a kill at any moment."""

from __future__ import annotations

import hashlib
import os
from array import array
from collections.abc import Iterator, Sequence
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.aedat4 import compression as compressions
from evs.drivers.files.aedat4 import description, layout
from evs.drivers.files.aedat4.frames import frame_body
from evs.drivers.files.aedat4.imu import imu_body
from evs.drivers.files.recording import one_stream, target_error
from evs.emulator.stages import Meter, NoMeter
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, StreamInfo

MAX_PACKET_EVENTS = 1 << 22
"""A tick of more events is written as several packets (64 MiB each, uncompressed)."""

MAX_TABLE_PACKETS = 1 << 20
"""A longer recording gets no data table, which readers then build themselves: bounds memory."""


class Aedat4Recorder:
    """A Sink that writes AEDAT4, unbuffered: a packet is with the system when write returns.

    A file without its data table (killed before close) is whole for every reader; the table at
    the end only lets dv-processing seek without a first pass. Ticks without events leave no packet.

    The table and the header's pointer to it cannot be written at one instant. A reader that finds
    no pointer takes the table for a packet, and must then take it for a torn one. Half of all
    compressed tables look like that by chance, so padding is tried; an uncompressed one never does,
    so `none` has no table.
    """

    def __init__(self, path: str | os.PathLike[str], compression: str = "lz4") -> None:
        """In: target file (replaced at open), `none`, `lz4` or `zstd`."""
        self.meter: Meter = NoMeter()
        self._path = Path(path)
        self._compression = compression
        self._compress = compressions.compressor(compression)
        self._file: FileIO | None = None
        self._stream: StreamInfo | None = None
        self._pointer_at = 0
        self._position = 0
        self._packets = 0
        self._events = 0
        self._empty = 0
        self._frames = 0
        self._imu_samples = 0
        self._table = array("q")
        self._failure = ""
        self._has_table = False

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file and write its header. EvsError: several cameras, or no place to write."""
        self._stream = one_stream(self._path, streams)
        xml = description.to_xml(self._stream, self._compression)
        header = layout.io_header(compressions.NUMBERS[self._compression], xml)
        pointer_at = layout.parse_io_header(header).table_position_at
        self._pointer_at = len(layout.MAGIC) + (pointer_at or 0)
        try:
            self._file = FileIO(self._path, "w")
        except OSError as reason:
            raise target_error(self._path, reason) from None
        try:
            self._append(layout.MAGIC + header)
        except EvsError:
            self._file.close()
            self._file = None
            raise

    def write(self, packet: EventPacket) -> None:
        """Append one packet. EvsError where the disk does not take it; what came before stays."""
        if self._failure:
            raise EvsError(self._failure)
        events = packet.events
        self._empty += not len(events)
        for start in range(0, len(events), MAX_PACKET_EVENTS):
            part = events[start : start + MAX_PACKET_EVENTS]
            span = int(part["t"][0]), int(part["t"][-1])
            self._put(description.EVENT_STREAM, layout.events_body(part), len(part), span)
            self._events += len(part)

    def write_frame(self, frame: Frame) -> None:
        """Append one intensity frame. EvsError as write; also where the stream has no frames."""
        self._check_declared("frames", "intensity frames")
        span = frame.exposure_begin_us, frame.exposure_begin_us
        self._put(description.FRAME_STREAM, frame_body(frame), 1, span)
        self._frames += 1

    def write_imu(self, packet: ImuPacket) -> None:
        """Append the samples of one packet. EvsError as write; also where the stream has no IMU."""
        self._check_declared("imu", "IMU samples")
        if len(packet):
            stamps = packet.samples["t"]
            span = int(stamps[0]), int(stamps[-1])
            self._put(description.IMU_STREAM, imu_body(packet.samples), len(packet), span)
            self._imu_samples += len(packet)

    def _check_declared(self, key: str, what: str) -> None:
        if self._stream is not None and not getattr(self._stream, key):
            raise EvsError(
                f"{self._path} was opened for a camera without {what}: set {key} of its StreamInfo"
            )

    def _put(self, stream: int, plain: bytes, elements: int, span_us: tuple[int, int]) -> None:
        """Append one packet of a stream, and its row of the table."""
        if self._failure:
            raise EvsError(self._failure)
        body = self._compress(plain)
        offset = self._position + layout.PACKET_HEADER.size
        self.meter.lap("pack")
        self._append(layout.PACKET_HEADER.pack(stream, len(body)) + body)
        self._packets += 1
        if self._packets <= MAX_TABLE_PACKETS:
            self._table.extend((stream, offset, len(body), elements, *span_us))

    def close(self) -> dict[str, Any]:
        """Append the data table and let go of the file. Never raises for a disk that is full."""
        if self._file is not None:
            compressed = self._compression != "none"
            if compressed and not self._failure and 0 < self._packets <= MAX_TABLE_PACKETS:
                self._write_table()
            self._file.close()
            self._file = None
        return {
            "type": "aedat4",
            "path": str(self._path),
            "compression": self._compression,
            "packets": self._packets,
            "empty_ticks": self._empty,
            "events": self._events,
            "frames": self._frames,
            "imu_samples": self._imu_samples,
            "bytes": self._position,
            "table": self._has_table,
            "error": self._failure,
        }

    def _write_table(self) -> None:
        rows = np.frombuffer(self._table, np.int64).reshape(-1, 1 + layout.TABLE_COLUMNS)
        for padding in _paddings():
            table = self._compress(layout.data_table(rows[:, 0], rows[:, 1:], padding))
            if _looks_torn(table):
                break
        else:
            return
        position = self._position
        try:
            self._append(table)
        except EvsError:
            # no room for the table: the recording is whole without it
            self._failure = ""
            return
        assert self._file is not None
        # the header points to the table only once it is there
        os.pwrite(self._file.fileno(), position.to_bytes(8, "little"), self._pointer_at)
        self._has_table = True

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
            raise EvsError(self._failure) from None
        self._position += len(data)


def _looks_torn(table: bytes) -> bool:
    """Whether these bytes, taken for a packet, state a size that runs past their end."""
    header = layout.PACKET_HEADER.size
    size: int = layout.PACKET_HEADER.unpack_from(table)[1]
    return size > len(table) - header


def _paddings() -> Iterator[bytes]:
    """Paddings for a table, of which a few are enough to change how its frame begins."""
    # bytes 4-7 of a frame hold the low bits of its first block's size, or (a large ZSTD frame) the
    # third byte of its content's; noise changes the first where all else is compressible, zeros
    # where nothing is, and 8 MiB of zeros change the last
    for more in (0, 1 << 23):
        for step in range(0, 16 * 1096, 1096):
            yield hashlib.shake_128().digest(step) + bytes(step + more)
