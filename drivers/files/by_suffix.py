"""Recordings by the ending of their name: read, stream, sum up, repair, record."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.drivers.files.aedat4 import Aedat4File, Aedat4Recorder, Repair
from evs.drivers.files.aedat4 import repair as repair_aedat4
from evs.drivers.files.npz import NpzFile, NpzRecorder
from evs.drivers.files.recording import Recording, as_packet
from evs.drivers.sink import Sink
from evs.msgs import EventPacket, EvsError, StreamInfo, join_events

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

    @property
    def duration_s(self) -> float:
        """From the first event to the last, s."""
        return (self.last_us - self.first_us) * 1e-6

    @property
    def rate_hz(self) -> float | None:
        """Mean events per second; None for a recording without duration."""
        return self.events / self.duration_s if self.duration_s else None


def read(path: AnyPath) -> Recording:
    """All events of a recording, with `.stream` for the rest.

    A torn tail or damaged packets are left out, with a TornTailWarning or DamagedPacketWarning.
    EvsError: no such file, unknown ending, not a recording.
    """
    file = opened(path)
    parts = list(file.events())
    file.damage.warn(file.path)
    return Recording.of(join_events(parts), file.stream)


def packets(path: AnyPath) -> Iterator[EventPacket]:
    """The recording's packets one by one, numbered from 0; their events are read-only.

    Ticks without events were not recorded and do not come back. Warns like read, at the end.
    """
    file = opened(path)
    for seq, events in enumerate(file.events()):
        yield as_packet(seq, events, file.stream)
    file.damage.warn(file.path)


def stream_of(path: AnyPath) -> StreamInfo:
    """What a recording says of its stream: resolution, camera, seed, configuration, ..."""
    return opened(path).stream


def summary(path: AnyPath) -> Summary:
    """Walk over a whole recording and count. Damage is told, not warned of."""
    file = opened(path)
    count = packets_seen = on = first_us = last_us = 0
    for events in file.events():
        if not packets_seen:
            first_us = int(events["t"][0])
        last_us = int(events["t"][-1])
        on += int(np.count_nonzero(events["p"]))
        count += len(events)
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
    )


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
