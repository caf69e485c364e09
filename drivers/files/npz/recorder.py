"""NpzRecorder: one camera's packets into an NPZ archive that appears when it is closed."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from evs.drivers.allocate import allocate
from evs.drivers.files.capabilities import one_stream
from evs.drivers.files.npz.auxiliary import LABEL_ARRAYS, PIXELS, STAMPS, arrays_of
from evs.drivers.files.npz.columns import ArraySpool, write_array
from evs.drivers.files.paths import stopped_text, target_error
from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.msgs import (
    EVENT_DTYPE,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    StreamInfo,
    TriggerPacket,
    Triggers,
)

COLUMNS = ("t", "x", "y", "p")
"""Arrays of a recording, each (n,): t us, x and y px, p 1 ON or 0 OFF."""

STREAM = "stream"
"""scalar string array with the StreamInfo as JSON"""

_RESERVE_BYTES = 1 << 20


class NpzRecorder(Sink):
    """A Sink that spools events and frames, and writes the archive when it is closed.

    The file appears whole or not at all. Room for it is reserved as events come, so that a full
    disk is noticed by `write`, and what came before can still be written by `close`. While it
    records it takes up to 27 bytes an event beside the target. A killed process leaves nothing:
    record to .aedat4 where that may happen.
    """

    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU, Stream.TRIGGERS})

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self._temporary = self._path.parent / f".{self._path.name[:40]}.{os.getpid()}.{id(self)}"
        self._stream: StreamInfo | None = None
        self._file: IO[bytes] | None = None
        self._spools: dict[str, ArraySpool] = {}
        self._frames: list[Frame] = []
        self._imu: list[ImuSamples] = []
        self._triggers: list[Triggers] = []
        self._labels = 0
        self._auxiliary_bytes = 0
        self._packets = 0
        self._events = 0
        self._reserved = 0
        self._failure = ""
        self._report: dict[str, Any] = {}

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the temporary file. EvsError: several cameras, or the file cannot be written."""
        self._stream = one_stream(self._path, streams)
        try:
            if self._path.exists() and self._path.is_dir():
                raise IsADirectoryError
            self._file = self._temporary.open("wb")
            self._reserve(0)
        except OSError as reason:
            self._discard()
            raise target_error(self._path, reason) from None

    def write(self, packet: EventPacket) -> None:
        """Spool one packet's events. SinkStoppedError: the disk is full."""
        self._check_open()
        count, labels = len(packet.events), packet.labels
        if count:
            rows = {name: packet.events[name] for name in COLUMNS}
            if labels is not None:
                rows |= {name: labels[name] for name in LABEL_ARRAYS}
            self._append(rows, count, 0 if labels is None else labels.nbytes)
            self._labels += 0 if labels is None else count
            self._events += count
            self._packets += 1

    def write_frame(self, frame: Frame) -> None:
        """Spool one intensity frame. Errors as `write`; EvsError if its size changes."""
        first = self._spools.get(PIXELS)
        pixels = frame.pixels
        if first is not None and (pixels.shape, pixels.dtype) != (first.shape, first.dtype):
            raise EvsError(
                f"{self._path} holds frames of one size: {first.shape} {first.dtype}, not "
                f"{pixels.shape} {pixels.dtype}; record to .aedat4"
            )
        self._append({PIXELS: pixels[np.newaxis]}, 0, pixels.nbytes + 8 * len(STAMPS))
        # the pixels are in the spool
        self._frames.append(dataclasses.replace(frame, pixels=pixels[:0].copy()))

    def write_imu(self, packet: ImuPacket) -> None:
        """Keep a copy of one packet's samples. Errors as `write`."""
        self._append({}, 0, packet.samples.nbytes)
        self._imu.append(packet.samples.copy())

    def write_triggers(self, packet: TriggerPacket) -> None:
        """Keep a copy of one packet's triggers. Errors as `write`."""
        self._append({}, 0, packet.triggers.nbytes)
        self._triggers.append(packet.triggers.copy())

    def _check_open(self) -> None:
        if self._failure:
            raise SinkStoppedError(self._failure)
        if self._file is None:
            raise EvsError(f"{self._path} is not open for recording: call open first")

    def _append(
        self, rows: dict[str, np.ndarray[Any, Any]], events: int, auxiliary_bytes: int
    ) -> None:
        """Reserve space for more rows and spool them; SinkStoppedError keeps what came before."""
        self._check_open()
        try:
            self._reserve(self._events + events, self._auxiliary_bytes + auxiliary_bytes)
            for name, values in rows.items():
                if name not in self._spools:
                    made = ArraySpool(self._path.parent, values.dtype, values.shape[1:])
                    self._spools[name] = made
                self._spools[name].append(values)
        except OSError as reason:
            self._failure = stopped_text(self._path, self._events, reason, "they are kept")
            raise SinkStoppedError(self._failure) from None
        self._auxiliary_bytes += auxiliary_bytes

    def close(self) -> dict[str, Any]:
        """Write the archive and close it. EvsError: it cannot be written."""
        if self._file is None or self._stream is None:
            return self._report
        try:
            with zipfile.ZipFile(self._file, "w", zipfile.ZIP_DEFLATED) as archive:
                self._write_arrays(archive, self._stream)
            size = self._file.tell()
            self._file.truncate()
            self._file.close()
            self._temporary.replace(self._path)
        except OSError as reason:
            raise target_error(self._path, reason) from None
        finally:
            self._discard()
        self._report = {
            "type": "npz",
            "path": str(self._path),
            "packets": self._packets,
            "events": self._events,
            "frames": len(self._frames),
            "imu_samples": sum(map(len, self._imu)),
            "triggers": sum(map(len, self._triggers)),
            "bytes": size,
            "error": self._failure,
        }
        return self._report

    def _write_arrays(self, archive: zipfile.ZipFile, stream: StreamInfo) -> None:
        for name in COLUMNS:
            self._spool(name, EVENT_DTYPE[name]).write_to(archive, name, self._events)
        stream_json = json.dumps(dataclasses.asdict(stream), default=str)
        write_array(archive, STREAM, np.array(stream_json))
        if self._frames:
            self._spools[PIXELS].write_to(archive, PIXELS, len(self._frames))
        for name, values in arrays_of(self._frames, self._imu, self._triggers).items():
            write_array(archive, name, values)
        if self._labels:
            for name in LABEL_ARRAYS:
                self._spools[name].write_to(archive, name, self._labels)

    def _spool(self, name: str, dtype: np.dtype[Any]) -> ArraySpool:
        """The spool of this name, a new one where there is none."""
        if name not in self._spools:
            self._spools[name] = ArraySpool(self._path.parent, dtype)
        return self._spools[name]

    def _reserve(self, events: int, auxiliary_bytes: int = 0) -> None:
        """Allocate the temporary file for so much data; OSError: the disk is full."""
        # incompressible columns grow by less than a byte an event; the rest is header and stream
        needed = _RESERVE_BYTES + 14 * events + auxiliary_bytes + auxiliary_bytes // 1000
        if needed > self._reserved and self._file is not None:
            grown = needed + _RESERVE_BYTES
            allocate(self._file.fileno(), grown)
            self._reserved = grown

    def _discard(self) -> None:
        """Close and remove the temporary files."""
        for spool in self._spools.values():
            spool.close()
        self._spools = {}
        if self._file is not None:
            self._file.close()
            self._file = None
        # it may never have come about: the folder is none, the disk is read-only
        with contextlib.suppress(OSError):
            self._temporary.unlink()
