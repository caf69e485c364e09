"""Aedat4Recorder: one camera's packets into AEDAT4 files that survive a kill at any moment."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evs.drivers.files.aedat4 import compression as compressions
from evs.drivers.files.aedat4 import description, layout
from evs.drivers.files.aedat4.frames import frame_body
from evs.drivers.files.aedat4.imu import imu_body
from evs.drivers.files.aedat4.triggers import triggers_body
from evs.drivers.files.aedat4.writer import Aedat4Writer
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
"""What else of it, and of its padding as a rule."""


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
        """In: target file (replaced at open), `none`, `lz4` or `zstd`; 0: no rotation."""
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
            # a table would take the room that the disk has not got
            self._has_table = self._writer.close(table=not self._failure)
            self._counts["bytes"] += self._writer.bytes
            self._writer = None

    def _stop(self, reason: OSError) -> None:
        what = reason.strerror
        if isinstance(reason, FileExistsError):
            what = f"{part_path(self._path, self._parts)} already exists"
        self._failure = (
            f"recording to {self._path} stopped after {self._counts['events']} events: "
            f"{what}; what was recorded is readable, free some space and run again"
        )
        raise SinkStoppedError(self._failure) from None
