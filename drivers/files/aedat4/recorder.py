"""Aedat4Recorder: one camera's packets into AEDAT4 files that survive a kill at any moment.

Aedat4Writer writes one file; the recorder starts further ones.
"""

from __future__ import annotations

import hashlib
import math
import os
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.aedat4 import compression as compressions
from evs.drivers.files.aedat4 import description, layout
from evs.drivers.files.aedat4.auxiliary import frame_body, imu_body, triggers_body
from evs.drivers.files.capabilities import one_stream
from evs.drivers.files.multi_file import check_no_parts, part_path
from evs.drivers.files.paths import target_error
from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, StreamInfo, TriggerPacket

MAX_PACKET_EVENTS = 1 << 22
"""A tick of more events is written as several packets (64 MiB each, uncompressed)."""

_TABLE_BYTES = 48
"""A row of the data table, uncompressed."""
_TABLE_ROOM = 4096
"""The rest of the table and, as a rule, its padding."""


class Aedat4Recorder(Sink):
    """A Sink that writes AEDAT4, unbuffered: a packet is with the system when write returns.

    Ticks without events leave no packet. With `rotate_mb` or `rotate_s` the recording goes on in
    further files, `run-001.aedat4` after `run.aedat4`, each whole in itself: a file is ended before
    it would grow over `rotate_mb` (unless one packet alone does), and with the tick that ends its
    `rotate_s` simulated seconds. A full disk stops the recording: SinkStoppedError, and all that
    was taken before is readable.
    """

    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU, Stream.TRIGGERS})

    def __init__(
        self,
        path: str | os.PathLike[str],
        compression: str = "lz4",
        *,
        rotate_mb: float = 0.0,
        rotate_s: float = 0.0,
    ) -> None:
        """Make a recorder that is not open yet.

        Args:
            path: The file to write, which is replaced at open.
            compression: none, lz4 or zstd.
            rotate_mb: Largest size of a file, MB; 0: no limit.
            rotate_s: Longest simulated time of a file, s; 0: no limit.

        Raises:
            EvsError: A limit is negative or not finite, or the compression is unknown.
        """
        for name, value in (("rotate_mb", rotate_mb), ("rotate_s", rotate_s)):
            if not (math.isfinite(value) and value >= 0):
                raise EvsError(f"{name} is {value:g}: give a number over 0, or 0 for one file")
        self._path = Path(path)
        self._compression = compression
        self._compress = compressions.compressor(compression)
        self._rotate_bytes = round(rotate_mb * 1e6)
        self._rotate_us = round(rotate_s * 1e6)
        self._writer: Aedat4Writer | None = None
        self._stream: StreamInfo | None = None
        self._is_open = False
        self._parts = 0
        self._part_ends_us: int | None = None
        self._failure = ""
        self._counts = {"packets": 0, "empty_ticks": 0, "events": 0, "frames": 0}
        self._counts |= {"imu_samples": 0, "triggers": 0, "bytes": 0}
        self._has_table = False

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file and its header. EvsError: several cameras, or it cannot be written."""
        self._stream = one_stream(self._path, streams)
        if self._rotates:
            check_no_parts(self._path)
        try:
            self._start_part()
        except OSError as reason:
            raise target_error(self._path, reason) from None
        self._is_open = True

    def write(self, packet: EventPacket) -> None:
        """Append one packet. SinkStoppedError: the disk is full."""
        self._check_open()
        events = packet.events
        self._counts["empty_ticks"] += not len(events)
        for start in range(0, len(events), MAX_PACKET_EVENTS):
            part = events[start : start + MAX_PACKET_EVENTS]
            span = int(part["t"][0]), int(part["t"][-1])
            self._append(description.EVENT_STREAM, layout.events_body(part), len(part), span)
            self._counts["events"] += len(part)
        if self._rotate_us:
            self._end_tick(packet)

    def write_frame(self, frame: Frame) -> None:
        """Append one intensity frame. Errors as write; EvsError where the stream has no frames."""
        self._check_declared("frames", "intensity frames")
        span = frame.exposure_begin_us, frame.exposure_begin_us
        self._append(description.FRAME_STREAM, frame_body(frame), 1, span)
        self._counts["frames"] += 1

    def write_imu(self, packet: ImuPacket) -> None:
        """Append one packet's samples. Errors as `write`; EvsError if the stream has no IMU."""
        self._check_declared("imu", "IMU samples")
        if len(packet):
            stamps = packet.samples["t"]
            span = int(stamps[0]), int(stamps[-1])
            self._append(description.IMU_STREAM, imu_body(packet.samples), len(packet), span)
            self._counts["imu_samples"] += len(packet)

    def write_triggers(self, packet: TriggerPacket) -> None:
        """Append the triggers of one packet. Errors as write; EvsError where there are none."""
        self._check_declared("triggers", "triggers")
        if len(packet):
            stamps = packet.triggers["t"]
            span = int(stamps[0]), int(stamps[-1])
            body = triggers_body(packet.triggers)
            self._append(description.TRIGGER_STREAM, body, len(packet), span)
            self._counts["triggers"] += len(packet)

    def close(self) -> dict[str, Any]:
        """Write the data table and close the file. A full disk is not an error here."""
        self._end_part()
        self._is_open = False
        report = {
            "type": "aedat4",
            "path": str(self._path),
            "compression": self._compression,
            **self._counts,
            "table": self._has_table,
            "error": self._failure,
        }
        return report | ({"files": self._parts} if self._rotates else {})

    @property
    def _rotates(self) -> bool:
        return bool(self._rotate_bytes or self._rotate_us)

    def _check_open(self) -> None:
        if self._failure:
            raise SinkStoppedError(self._failure)
        if not self._is_open:
            raise EvsError(f"{self._path} is not open for recording: call open first")

    def _check_declared(self, key: str, what: str) -> None:
        if self._stream is not None and not getattr(self._stream, key):
            raise EvsError(
                f"{self._path} was opened for a camera without {what}: set {key} of its StreamInfo"
            )

    def _append(self, stream: int, plain: bytes, elements: int, span_us: tuple[int, int]) -> None:
        """Append one packet of a stream, to the next file if this one is full."""
        self._check_open()
        body = self._compress(plain)
        self.meter.lap("pack")
        if self._writer is not None and self._is_too_large(self._writer, len(body)):
            self._end_part()
        try:
            if self._writer is None:
                self._start_part()
            assert self._writer is not None
            self._writer.append(stream, body, elements, span_us)
        except OSError as reason:
            self._stop(reason)
        self._counts["packets"] += 1

    def _is_too_large(self, writer: Aedat4Writer, body_bytes: int) -> bool:
        """Whether the file would pass its size with one more packet and the table."""
        if not (self._rotate_bytes and writer.packets):
            return False
        table = 0 if self._compression == "none" else _TABLE_BYTES * (writer.packets + 1)
        room = layout.PACKET_HEADER.size + body_bytes + table + (_TABLE_ROOM if table else 0)
        return writer.bytes + room > self._rotate_bytes

    def _end_tick(self, packet: EventPacket) -> None:
        """End the file with the tick that ends its time; the next message begins another."""
        if self._part_ends_us is None:
            self._part_ends_us = packet.time_base_us + self._rotate_us
        if packet.time_end_us >= self._part_ends_us:
            passed = packet.time_end_us - self._part_ends_us
            self._part_ends_us += self._rotate_us * (1 + passed // self._rotate_us)
            if self._writer is not None and self._writer.packets:
                self._end_part()

    def _start_part(self) -> None:
        assert self._stream is not None
        number = self._parts
        xml = description.to_xml(
            self._stream, self._compression, part=number if self._rotates else None
        )
        self._writer = Aedat4Writer(
            part_path(self._path, number), xml, self._compression, new=number > 0
        )
        self._parts += 1

    def _end_part(self) -> None:
        if self._writer is not None:
            # the disk has no room for a table
            self._has_table = self._writer.close(table=not self._failure)
            self._counts["bytes"] += self._writer.bytes
            self._writer = None

    def _stop(self, reason: OSError) -> None:
        what = reason.strerror
        if isinstance(reason, FileExistsError):
            what = f"{part_path(self._path, self._parts)} already exists"
        self._failure = (
            f"recording to {self._path} stopped after {self._counts['events']} events: "
            f"{what}; the events before that are readable; free some space and run again"
        )
        raise SinkStoppedError(self._failure) from None


MAX_TABLE_PACKETS = 1 << 20
"""A longer file gets no data table, which readers then build themselves: bounds memory."""


class Aedat4Writer:
    """One file, written packet by packet, unbuffered: a packet is with the system on return.

    A file without its data table (killed before close) is whole for every reader; the table at
    the end only lets dv-processing seek without a first pass.

    The table and the header's pointer to it cannot be written at one instant. A reader that finds
    no pointer takes the table for a packet, and must then take it for a torn one. Half of all
    compressed tables look like that by chance, so padding is tried; an uncompressed one never does,
    so `none` has no table.
    """

    def __init__(self, path: Path, xml: str, compression: str, *, new: bool = False) -> None:
        """Create the file and write its header.

        Args:
            path: The file.
            xml: The description of its streams.
            compression: none, lz4 or zstd.
            new: Whether the file must not exist yet; if not, it is replaced.

        Raises:
            OSError: The file cannot be written.
        """
        self.path = path
        self.packets = 0
        self.bytes = 0
        """size of the file so far"""
        self._compressed = compression != "none"
        self._compress: Callable[[bytes], bytes] = compressions.compressor(compression)
        self._table = array("q")
        header = layout.io_header(compressions.NUMBERS[compression], xml)
        pointer_at = layout.parse_io_header(header).table_position_at
        self._pointer_at = len(layout.MAGIC) + (pointer_at or 0)
        self._file = FileIO(path, "x" if new else "w")
        try:
            self._append(layout.MAGIC + header)
        except OSError:
            self._file.close()
            if new:
                with suppress(OSError):
                    path.unlink()
            raise

    def append(self, stream: int, body: bytes, elements: int, span_us: tuple[int, int]) -> None:
        """Append one packet.

        Args:
            stream: Number of its stream.
            body: Its body, compressed.
            elements: Number of events, frames, samples or triggers in it, for the data table.
            span_us: Its first and its last time stamp, us, for the data table.

        Raises:
            OSError: The disk does not take it; the file is then as it was before.
        """
        offset = self.bytes + layout.PACKET_HEADER.size
        self._append(layout.PACKET_HEADER.pack(stream, len(body)), body)
        self.packets += 1
        if self.packets <= MAX_TABLE_PACKETS:
            self._table.extend((stream, offset, len(body), elements, *span_us))

    def close(self, table: bool = True) -> bool:
        """Append the data table and close the file. A full disk is not an error.

        Args:
            table: Whether a data table is wanted.

        Returns:
            Whether the file has one.
        """
        if self._file.closed:
            return False
        wanted = table and self._compressed and 0 < self.packets <= MAX_TABLE_PACKETS
        has_table = wanted and self._write_table()
        self._file.close()
        return has_table

    def _write_table(self) -> bool:
        rows = np.frombuffer(self._table, np.int64).reshape(-1, 1 + layout.TABLE_COLUMNS)
        for padding in _paddings():
            table = self._compress(layout.data_table(rows[:, 0], rows[:, 1:], padding))
            if _looks_torn(table):
                break
        else:
            return False
        position = self.bytes
        try:
            self._append(table)
        except OSError:
            # no room for the table: the recording is whole without it
            return False
        # the header points to the table only once it is there
        os.pwrite(self._file.fileno(), position.to_bytes(8, "little"), self._pointer_at)
        return True

    def _append(self, *parts: bytes) -> None:
        """Hand all bytes to the system, or leave the file unchanged and raise OSError."""
        size = sum(map(len, parts))
        try:
            # one call, and no copy of the parts side by side
            done = os.writev(self._file.fileno(), parts)
            if done < size:
                rest = memoryview(b"".join(parts))[done:]
                while rest:
                    rest = rest[self._file.write(rest) :]
        except OSError:
            with suppress(OSError):  # a device has no tail to cut
                os.ftruncate(self._file.fileno(), self.bytes)
                os.lseek(self._file.fileno(), self.bytes, os.SEEK_SET)
            raise
        self.bytes += size


def _looks_torn(table: bytes) -> bool:
    """Whether these bytes, taken for a packet, state a size that runs past their end."""
    header = layout.PACKET_HEADER.size
    size: int = layout.PACKET_HEADER.unpack_from(table)[1]
    return size > len(table) - header


def _paddings() -> Iterator[bytes]:
    """Paddings for a table; a few of them suffice to change how its compressed frame begins."""
    # bytes 4-7 of a frame hold the low bits of its first block's size, or (a large ZSTD frame) the
    # third byte of its content's; noise changes the first where all else is compressible, zeros
    # where nothing is, and 8 MiB of zeros change the last
    for more in (0, 1 << 23):
        for step in range(0, 16 * 1096, 1096):
            yield hashlib.shake_128().digest(step) + bytes(step + more)
