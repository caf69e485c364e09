"""Recordings by the ending of their name: read, stream, sum up, repair, record."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.drivers.files.aedat4 import Aedat4File, Aedat4Recorder, Repair
from evs.drivers.files.aedat4 import repair as repair_aedat4
from evs.drivers.files.npz import NpzFile, NpzRecorder
from evs.drivers.files.recording import Beside, Recording, as_packet
from evs.drivers.sink import Sink
from evs.msgs import (
    IMU_DTYPE,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    StreamInfo,
    join_events,
)


class LeftOutFramesWarning(UserWarning):
    """A recording holds frames in colour, which we do not read."""


SUFFIXES = (".aedat4", ".npz")

AnyPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Summary:
    """What `evs info` says of a recording."""

    path: str
    size: int
    """bytes"""
    compression: str
    stream: StreamInfo
    packets: int
    """whole packets that hold events"""
    events: int
    on: int
    off: int
    first_us: int
    """time stamp of the first event; 0 without events"""
    last_us: int
    table: bool
    """a whole data table lets dv-processing seek without a first pass"""
    broken_pointer: bool
    """the header points to a data table that is not there: dv-processing refuses the file"""
    torn_at: int | None
    """byte offset of a torn tail"""
    torn_bytes: int
    damaged_packets: int
    frames: int
    """intensity frames"""
    frame_rate_hz: float | None
    """mean of them per second; None for fewer than two"""
    imu_samples: int
    imu_rate_hz: float | None
    """mean of them per second; None for fewer than two"""

    @property
    def duration_s(self) -> float:
        """From the first event to the last, s."""
        return (self.last_us - self.first_us) * 1e-6

    @property
    def rate_hz(self) -> float | None:
        """Mean events per second; None for a recording without duration."""
        return self.events / self.duration_s if self.duration_s else None


def read(path: AnyPath) -> Recording:
    """All events of a recording, with `.stream`, `.frames` and `.imu` for the rest.

    A torn tail or damaged packets are left out, with a TornTailWarning or DamagedPacketWarning.
    EvsError: no such file, unknown ending, not a recording.
    """
    file = opened(path)
    parts = list(file.events())
    file.damage.warn(file.path)
    return Recording.of(join_events(parts), file.stream, Beside(lambda: _beside(path), file.labels))


def packets(path: AnyPath) -> Iterator[EventPacket]:
    """The recording's packets one by one, numbered from 0; their events are read-only.

    Ticks without events were not recorded and do not come back. Warns like read, at the end.
    """
    file = opened(path)
    for seq, events in enumerate(file.events()):
        yield as_packet(seq, events, file.stream)
    file.damage.warn(file.path)


def messages(path: AnyPath) -> Iterator[EventPacket | Frame | ImuPacket]:
    """Packets, frames and IMU packets one by one, in the order recorded. Warns like read."""
    file = opened(path)
    events = imu = 0
    for message in file.messages():
        if isinstance(message, Frame):
            yield message
        elif message.dtype == IMU_DTYPE:
            yield ImuPacket(imu, message, file.stream.camera)
            imu += 1
        else:
            yield as_packet(events, message, file.stream)
            events += 1
    _warn(file)


def _beside(path: AnyPath) -> Iterator[Frame | ImuSamples]:
    """What lies beside the events; where damage was met, reading those warned of it."""
    file = opened(path)
    if file.stream.frames or file.stream.imu:
        yield from file.beside()
        _warn_coloured(file)


def _warn(file: Aedat4File | NpzFile) -> None:
    file.damage.warn(file.path)
    _warn_coloured(file)


def _warn_coloured(file: Aedat4File | NpzFile) -> None:
    if file.coloured_frames:
        text = f"{file.path}: {file.coloured_frames} frames are not grey and were left out"
        warnings.warn(text, LeftOutFramesWarning, stacklevel=3)


def stream_of(path: AnyPath) -> StreamInfo:
    """What a recording says of its stream: resolution, camera, seed, configuration, ..."""
    return opened(path).stream


def summary(path: AnyPath) -> Summary:
    """Walk over a whole recording and count. Damage is told, not warned of."""
    file = opened(path)
    count = packets_seen = on = first_us = last_us = 0
    frame_stamps: list[int] = []
    imu_stamps: list[int] = []
    for message in file.messages():
        if isinstance(message, Frame):
            frame_stamps.append(message.exposure_begin_us)
            continue
        if message.dtype == IMU_DTYPE:
            imu_stamps += message["t"].tolist()
            continue
        if not packets_seen:
            first_us = int(message["t"][0])
        last_us = int(message["t"][-1])
        on += int(np.count_nonzero(message["p"]))
        count += len(message)
        packets_seen += 1
    return Summary(
        path=str(file.path),
        size=file.size,
        compression=file.compression,
        stream=file.stream,
        packets=packets_seen,
        events=count,
        on=on,
        off=count - on,
        first_us=first_us,
        last_us=last_us,
        table=file.table_packets is not None,
        broken_pointer=file.broken_pointer,
        torn_at=file.damage.torn_at,
        torn_bytes=file.damage.torn_bytes,
        damaged_packets=file.damage.packets,
        frames=len(frame_stamps),
        frame_rate_hz=_rate_hz(frame_stamps),
        imu_samples=len(imu_stamps),
        imu_rate_hz=_rate_hz(imu_stamps),
    )


def _rate_hz(stamps_us: list[int]) -> float | None:
    """Mean rate of what has these stamps."""
    if len(stamps_us) < 2 or stamps_us[-1] <= stamps_us[0]:
        return None
    return (len(stamps_us) - 1) * 1e6 / (stamps_us[-1] - stamps_us[0])


def repair(path: AnyPath) -> Repair:
    """Cut a torn tail in place; every whole packet stays. An .npz file is whole or not readable."""
    if _suffix(path) == ".npz":
        file = NpzFile.at(path)
        return Repair(file.path, 0, file.size, False)
    return repair_aedat4(path)


def recorder_for(path: AnyPath, compression: str = "lz4") -> Sink:
    """The recorder for a file name; `compression` is AEDAT4's: lz4, none or zstd."""
    return NpzRecorder(path) if _suffix(path) == ".npz" else Aedat4Recorder(path, compression)


def opened(path: AnyPath) -> Aedat4File | NpzFile:
    """The recording at a path, its header read."""
    return NpzFile.at(path) if _suffix(path) == ".npz" else Aedat4File.at(path)


def _suffix(path: AnyPath) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        known = " or ".join(SUFFIXES)
        raise EvsError(f"no recording format '{suffix}' (of {Path(path)}); names end in {known}")
    return suffix
