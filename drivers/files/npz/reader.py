"""NpzFile: reads NPZ recordings, which are arrays t, x, y, p for numpy.load."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.header_text import stream_from_json
from evs.drivers.files.integrity import IntegrityReport, bad_values
from evs.drivers.files.npz.auxiliary import frames_in, imu_of, labels_of, merge_by_time, triggers_of
from evs.drivers.files.npz.columns import Archive, NotARecordingError
from evs.drivers.files.npz.recorder import COLUMNS, STREAM, NpzRecorder
from evs.drivers.files.paths import existing
from evs.drivers.files.time_order import EventSorter
from evs.msgs import (
    Events,
    EvsError,
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    Triggers,
    empty_imu,
    empty_triggers,
    make_events,
)

__all__ = ["NpzFile", "NpzRecorder"]

_PIECE_EVENTS = 1 << 16


@dataclass
class NpzFile:
    """An NPZ recording of evs or of others, with integer arrays t, x, y, p of one length.

    Events and frames are read piece by piece; the rest is in memory.
    """

    path: Path
    stream: StreamInfo
    compression: str
    size: int
    events_there: int = 0
    frames_there: int = 0
    imu: ImuSamples = field(default_factory=empty_imu)
    """(n,) all of them"""
    triggers: Triggers = field(default_factory=empty_triggers)
    """(n,) all of them"""
    labels: Labels | None = None
    """(n,) as the events; None: it has none"""
    left_out: dict[str, int] = field(default_factory=dict)
    """always empty"""
    streams: dict[str, str] = field(default_factory=dict)
    """always empty"""
    position: int = 0
    """how far the current pass has come, bytes, in proportion to the events"""
    table_packets: int | None = None
    """an NPZ file has no data table"""
    broken_pointer: bool = False
    integrity: IntegrityReport = field(default_factory=IntegrityReport)
    """only time stamps that run backwards: an archive with wrong checksums is not opened"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> NpzFile:
        """Open a file and check all of it. EvsError: no such file, damaged, not a recording."""
        found = existing(path)
        opened = cls(found, StreamInfo(0, 0), "none", found.stat().st_size)
        try:
            with Archive(found) as archive:
                opened._probe(archive)
        except NotARecordingError as reason:
            raise EvsError(f"{found} is not a recording: {reason}") from None
        except Exception as reason:  # damaged bytes make zipfile and numpy raise a dozen kinds
            raise EvsError(f"cannot read {found}: {str(reason) or type(reason).__name__}") from None
        return opened

    def events(self) -> Iterator[Events]:
        """The events of each tick that has any."""
        integrity = IntegrityReport(place_unit="event")
        sorter = EventSorter(integrity, self.stream)
        at = 0
        with Archive(self.path) as archive:
            for events, _ in _pieces(archive):
                self.position = at * self.size // max(1, self.events_there)
                yield from sorter.feed(events, np.arange(at, at + len(events)))
                at += len(events)
        yield from sorter.flush()
        self.integrity = integrity

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """Events, frames, IMU samples and triggers of each tick, by time."""
        yield from merge_by_time(
            self.events(), self._frames(), self.imu, self.triggers, self.stream
        )

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers without the events."""
        yield from self._frames()
        yield self.imu
        yield self.triggers

    def _frames(self) -> Iterator[Frame]:
        if self.frames_there:
            with Archive(self.path) as archive:
                yield from frames_in(archive, self.stream.camera)

    def _probe(self, archive: Archive) -> None:
        """Read the whole archive once, to check its checksums and values and find its streams."""

        def get(name: str, kinds: str, axes: int) -> np.ndarray[Any, Any]:
            return archive.column(name, kinds, axes).all()

        names = [name.removesuffix(".npy") for name in archive.namelist()]
        compressed = archive.column("t", "iub", 1).is_compressed
        stated_json: Any = {}
        if STREAM in names:
            try:
                stated_json = json.loads(str(get(STREAM, "U", 0)))
            except (ValueError, RecursionError):
                stated_json = {}
        stated = stream_from_json(stated_json, StreamInfo(0, 0, sensor="unknown"))
        width = height = 0
        backwards, last_us = False, -(1 << 63)
        for events, fits in _pieces(archive):
            stamps = events["t"]
            backwards |= bool((stamps[1:] < stamps[:-1]).any()) or int(stamps[0]) < last_us
            last_us = int(stamps[-1])
            wrong = bad_values(events, stated)
            if wrong or not fits:
                raise NotARecordingError(wrong or "a value is too large for an event")
            width = max(width, 1 + int(events["x"].max()))
            height = max(height, 1 + int(events["y"].max()))
            self.events_there += len(events)
        self.frames_there = sum(1 for _ in frames_in(archive, ""))
        self.imu, self.triggers = imu_of(names, get), triggers_of(names, get)
        self.labels = labels_of(names, get, self.events_there)
        if backwards and self.labels is not None:
            raise NotARecordingError("its time stamps run backwards, and labels go with them")
        self.compression = "deflate" if compressed else "none"
        plain = StreamInfo(max(1, width), max(1, height), sensor="unknown")
        stream = stated if 0 < stated.width <= MAX_SIDE_PX else stream_from_json(stated_json, plain)
        # archives of other programs do not state them
        self.stream = dataclasses.replace(
            stream,
            frames=stream.frames or bool(self.frames_there),
            imu=stream.imu or bool(len(self.imu)),
            triggers=stream.triggers or bool(len(self.triggers)),
        )


def _pieces(archive: Archive) -> Iterator[tuple[Events, bool]]:
    """For each piece: (n,) events as recorded, n > 0, and whether every value fits."""
    columns = [archive.column(name, "iub", 1) for name in COLUMNS]
    if len({column.shape for column in columns}) > 1:
        raise NotARecordingError("t, x, y, p are not of one length")
    while columns[0].left:
        t, x, y, p = (column.read(_PIECE_EVENTS) for column in columns)
        events = make_events(t, x, y, p > 0)
        pairs = zip("txy", (t, x, y), strict=True)
        yield events, all(np.array_equal(events[name], given) for name, given in pairs)
