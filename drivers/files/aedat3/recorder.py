"""Aedat3Recorder: one camera's events, frames and IMU samples into an AEDAT3.1 file."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from evs.drivers.files.aedat3.layout import (
    END,
    EVENT,
    EVS_LINE,
    FRAME,
    FRAME_HEAD,
    FRAME_STAMP_AT,
    IMU,
    IMU6,
    MAGIC,
    POLARITY,
    SIZES,
    SPAN_US,
    Head,
)
from evs.drivers.files.appending_recorder import AppendingRecorder
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.header_text import stream_json
from evs.drivers.sink import SinkStoppedError, Stream
from evs.msgs import (
    DEGREE,
    STANDARD_GRAVITY,
    Events,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    StreamInfo,
)

_SOURCE = 1
_TO_16_BITS = 257
"""scales 8 bits to 16: 255 -> 65535"""


class Aedat3Recorder(AppendingRecorder):
    """A Sink that writes AEDAT3.1; a packet that the clock's wrap lies in becomes two.

    Frames have 16 bits there: those of 8 bits are spread over them (times 257). IMU samples are
    single precision.
    """

    NAME = "aedat3"
    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU})

    def __init__(self, path: AnyPath) -> None:
        super().__init__(path)
        self._counts = {"frames": 0, "imu_samples": 0}

    def write_frame(self, frame: Frame) -> None:
        """Append one frame. Errors as `write`; EvsError if the stream has no frames."""
        self._check("frames", frame.begin_us)
        data = frame_packet(frame)
        self.meter.lap("pack")
        self._append(data)
        self._counts["frames"] += 1

    def write_imu(self, packet: ImuPacket) -> None:
        """Append one packet's samples. Errors as `write`; EvsError if the stream has no IMU."""
        if len(packet):
            self._check("imu", int(packet.samples["t"][0]))
            data = b"".join(imu_packet(part) for part in _between_wraps(packet.samples))
            self.meter.lap("pack")
            self._append(data)
            self._counts["imu_samples"] += len(packet)

    def close(self) -> dict[str, Any]:
        """As AppendingRecorder's, with the numbers of frames and samples."""
        return super().close() | self._counts

    def _check(self, key: str, t_us: int) -> None:
        if self._failure:
            raise SinkStoppedError(self._failure)
        if self._file is not None and not getattr(self.stream, key):
            raise EvsError(f"{self._path} was opened without {key}: set {key} of its StreamInfo")
        if t_us < 0:
            raise EvsError(f"cannot record {key} at {t_us} us to {self._path}: .aedat4 holds them")

    def _header(self, stream: StreamInfo) -> bytes:
        # triggers go elsewhere
        stream_line = stream_json(dataclasses.replace(stream, triggers=False))
        lines = [
            MAGIC.decode(),
            "#Format: RAW",
            f"#Source {_SOURCE}: {stream.sensor.upper()}",
            "#Start-Time: 1970-01-01 00:00:00 (TZ+0000)",
            EVS_LINE + stream_line,
            END.decode(),
        ]
        return "".join(f"{line}\r\n" for line in lines).encode()

    def _encode(self, events: Events) -> bytes:
        return b"".join(events_packet(part) for part in _between_wraps(events))


def events_packet(events: Events) -> bytes:
    """One packet of events, (n,), between two wraps."""
    body = np.empty(len(events), EVENT)
    x, y = events["x"].astype(np.uint32), events["y"].astype(np.uint32)
    body["data"] = x << 17 | y << 2 | (events["p"] != 0).astype(np.uint32) << 1 | 1
    body["stamp"] = events["t"] & (SPAN_US - 1)
    return _head(POLARITY, int(events["t"][0]), len(events)) + body.tobytes()


def imu_packet(samples: ImuSamples) -> bytes:
    """One packet of IMU samples, (n,), between two wraps."""
    body = np.zeros(len(samples), IMU[IMU6])
    body["info"] = 1
    body["stamp"] = samples["t"] & (SPAN_US - 1)
    body["acceleration"] = samples["acceleration"] / STANDARD_GRAVITY
    body["angular_velocity"] = samples["angular_velocity"] / DEGREE
    body["temperature"] = samples["temperature"]
    return _head(IMU6, int(samples["t"][0]), len(samples)) + body.tobytes()


def frame_packet(frame: Frame) -> bytes:
    """One packet of one frame. Time stamps after a wrap of the clock are lower than its start."""
    stamps = frame.begin_us, frame.end_us, frame.exposure_begin_us, frame.exposure_end_us
    wrapped = (t_us & (SPAN_US - 1) for t_us in stamps)
    head = FRAME_HEAD.pack(1 | 1 << 1, *wrapped, frame.width, frame.height, frame.left, frame.top)
    pixels = frame.pixels.astype("<u2")
    if frame.pixels.dtype == np.uint8:
        pixels = pixels * _TO_16_BITS
    size = len(head) + pixels.nbytes
    return _head(FRAME, frame.begin_us, 1, (size, FRAME_STAMP_AT)) + head + pixels.tobytes()


def _head(kind: int, t_us: int, count: int, sizes: tuple[int, int] | None = None) -> bytes:
    sizes = sizes or SIZES[kind]
    return Head(kind, _SOURCE, *sizes, t_us // SPAN_US, count, count, count).packed()


def _between_wraps(rows: Any) -> list[Any]:
    """Split rows, (n,) sorted by a field t, where the clock wraps."""
    return np.split(rows, np.flatnonzero(np.diff(rows["t"] // SPAN_US)) + 1)
