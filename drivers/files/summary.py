"""Summary: the contents of a recording, as `evs info` prints them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

import numpy as np

from evs.drivers.files.formats import AnyPath, ReadOptions, to_read
from evs.drivers.files.multi_file import open_recording, paths_of
from evs.drivers.files.reading import check_readable
from evs.msgs import IMU_DTYPE, TRIGGER_DTYPE, Frame, StreamInfo


@dataclass(frozen=True)
class Summary:
    """The contents of a recording."""

    path: str
    format: str
    """name in the table of formats"""
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
    """lowest time stamp; 0 without events"""
    last_us: int
    table: bool
    """a whole data table lets dv-processing seek without a first pass"""
    broken_pointer: bool
    """the header points to a data table that does not exist: dv-processing refuses the file"""
    torn_at: int | None
    """byte offset of a torn tail"""
    torn_bytes: int
    damaged_packets: int
    damaged_what: str
    """what they are called: packets, words, lines"""
    backwards: str
    """one line on time stamps that run backwards; empty if none do"""
    left_out: dict[str, int]
    """valid data that was not read: what it is -> how many"""
    streams: dict[str, str]
    """key -> name of its event streams, the one that is read first; empty: there is one"""
    frames: int
    """intensity frames"""
    frame_rate_hz: float | None
    """mean of them per second; None for fewer than two"""
    imu_samples: int
    imu_rate_hz: float | None
    """mean of them per second; None for fewer than two"""
    triggers: int
    unfinished: bool
    """its recorder was killed: other programs need `evs info --repair` first"""
    files: list[str]
    """its files, if there are several"""
    read_as: str = ""
    """what was decided on what the file does not state: columns and unit; empty: nothing"""

    @property
    def duration_s(self) -> float:
        """From the first event to the last, s."""
        return (self.last_us - self.first_us) * 1e-6

    @property
    def rate_hz(self) -> float | None:
        """Mean events per second; None for a recording without duration."""
        return self.events / self.duration_s if self.duration_s else None


def summary(path: AnyPath, **options: Unpack[ReadOptions]) -> Summary:
    """Read a whole recording and count what it contains. Damage is reported, without warnings.

    Args:
        path: The recording, or the first file of one in several files.
        **options: See `read`.

    Raises:
        EvsError: The file does not exist, its ending is unknown, or it is not a recording.
    """
    kind = to_read(path)
    file = open_recording(path, kind, **options)
    count = packets_seen = on = first_us = last_us = triggers = 0
    frame_stamps: list[int] = []
    imu_stamps: list[int] = []
    for message in file.messages():
        if isinstance(message, Frame):
            frame_stamps.append(message.exposure_begin_us)
            continue
        if message.dtype == IMU_DTYPE:
            imu_stamps += message["t"].tolist()
            continue
        if message.dtype == TRIGGER_DTYPE:
            triggers += len(message)
            continue
        begin_us, end_us = int(message["t"][0]), int(message["t"][-1])
        first_us = min(first_us, begin_us) if packets_seen else begin_us
        last_us = max(last_us, end_us) if packets_seen else end_us
        on += int(np.count_nonzero(message["p"]))
        count += len(message)
        packets_seen += 1
    check_readable(file, bool(count or frame_stamps or imu_stamps or triggers))
    return Summary(
        path=str(file.path),
        format=getattr(file, "format_name", kind.name),
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
        torn_at=file.integrity.torn_at,
        torn_bytes=file.integrity.torn_bytes,
        damaged_packets=file.integrity.packets,
        damaged_what=file.integrity.noun,
        backwards=file.integrity.backwards_text(),
        left_out=dict(file.left_out),
        streams=dict(file.streams),
        frames=len(frame_stamps),
        frame_rate_hz=_rate_hz(frame_stamps),
        imu_samples=len(imu_stamps),
        imu_rate_hz=_rate_hz(imu_stamps),
        triggers=triggers,
        unfinished=getattr(file, "unfinished", False),
        files=[str(one) for one in paths_of(file)] if paths_of(file) != [file.path] else [],
        read_as=getattr(file, "read_as", ""),
    )


def _rate_hz(stamps_us: list[int]) -> float | None:
    """Mean rate of samples with these time stamps, Hz; None for fewer than two."""
    if len(stamps_us) < 2 or stamps_us[-1] <= stamps_us[0]:
        return None
    return (len(stamps_us) - 1) * 1e6 / (stamps_us[-1] - stamps_us[0])
