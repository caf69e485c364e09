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
from evs.drivers.files.layouts import (
    FIELDS,
    SAMPLE,
    Table,
    decide,
    events_of,
    layout_of,
    named_columns,
)
from evs.drivers.files.npz.auxiliary import frames_in, imu_of, labels_of, merge_by_time, triggers_of
from evs.drivers.files.npz.columns import (
    Arrays,
    NotARecordingError,
    OtherKindError,
    open_archive,
)
from evs.drivers.files.npz.recorder import STREAM, NpzRecorder
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
)

__all__ = ["NpzFile", "NpzRecorder"]

_PIECE_EVENTS = SAMPLE
_MAX_COLUMNS = 16


@dataclass
class NpzFile:
    """An NPZ recording of evs or of others: arrays of t, x, y, p, or one array with all of them.

    `layouts.py` decides which they are. Events and frames are read piece by piece; the rest is in
    memory.
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
    read_as: str = ""
    """what was decided on arrays that evs did not write"""
    arrays: tuple[str, ...] = ()
    """those of the events"""
    table: Table = field(default_factory=lambda: Table((0, 1, 2, 3), "us", ""))
    integrity: IntegrityReport = field(default_factory=IntegrityReport)
    """only time stamps that run backwards: an archive with wrong checksums is not opened"""

    @classmethod
    def at(cls, path: str | os.PathLike[str], columns: str = "", unit: str = "") -> NpzFile:
        """Open a file and check all of it.

        Args:
            path: The file.
            columns: What its columns hold, as `layouts.named_columns` reads it.
            unit: Of its times.

        Raises:
            EvsError: No such file, damaged, not a recording, or it is not clear what it holds.
        """
        found = existing(path)
        opened = cls(found, StreamInfo(0, 0), "none", found.stat().st_size)
        try:
            with open_archive(found) as archive:
                opened._probe(archive, columns, unit)
        except NotARecordingError as reason:
            raise EvsError(f"{found} is not a recording: {reason}") from None
        except EvsError:
            raise
        except Exception as reason:  # damaged bytes make zipfile and numpy raise a dozen kinds
            raise EvsError(f"cannot read {found}: {str(reason) or type(reason).__name__}") from None
        return opened

    def events(self) -> Iterator[Events]:
        """The events of each tick that has any."""
        integrity = IntegrityReport(place_unit="event")
        sorter = EventSorter(integrity, self.stream)
        at = 0
        with open_archive(self.path) as archive:
            for events, _ in self._events_in(archive):
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
            with open_archive(self.path) as archive:
                yield from frames_in(archive, self.stream.camera)

    def _events_in(self, archive: Arrays) -> Iterator[tuple[Events, bool]]:
        """For each piece: (n,) events as recorded, and whether every row is one."""
        for columns in _pieces(archive, self.arrays):
            t, x, y, p = (columns[place] for place in self.table.places)
            events, sound = events_of(t, x, y, p, self.table.unit)
            yield events, bool(sound.all())

    def _probe(self, archive: Arrays, columns: str, unit: str) -> None:
        """Read the whole archive once, to check its checksums and values and find its streams."""

        def get(name: str, kinds: str, axes: int) -> np.ndarray[Any, Any]:
            return archive.column(name, kinds, axes).all()

        names = archive.arrays
        self.arrays, fields = _place(archive, columns)
        compressed = archive.column(self.arrays[0], "iufbV", None).is_compressed
        stated_json: Any = {}
        if STREAM in names:
            try:
                stated_json = json.loads(str(get(STREAM, "U", 0)))
            except (ValueError, RecursionError):
                stated_json = {}
        stated = stream_from_json(stated_json, StreamInfo(0, 0, sensor="unknown"))
        sample = next(_pieces(archive, self.arrays), None)
        if sample is not None and not (stated.width and not columns and not unit):
            self.table = decide(
                self.path,
                sample,
                fields,
                columns="" if len(self.arrays) > 1 else columns,
                unit=unit,
                layout=layout_of(fields, None) if fields and not columns else None,
            )
            self.read_as = self.table.read_as
        width = height = 0
        backwards, last_us = False, -(1 << 63)
        for events, fits in self._events_in(archive):
            if not fits:
                raise NotARecordingError(
                    "a value is too large or too small for an event, or its polarity is unknown"
                )
            stamps = events["t"]
            backwards |= bool((stamps[1:] < stamps[:-1]).any()) or int(stamps[0]) < last_us
            last_us = int(stamps[-1])
            if wrong := bad_values(events, stated):
                raise NotARecordingError(wrong)
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


def _place(archive: Arrays, columns: str) -> tuple[tuple[str, ...], list[str] | None]:
    """Where the events are in an archive.

    Returns:
        Names of the arrays of t, x, y, p and those names again; or the name of one array, and the
        names of its fields, or None where it is a table without names.
    """
    named = []
    tables: dict[str, list[str] | None] = {}
    for name in archive.arrays:
        try:
            found = archive.column(name, "iufbV", None)
        except OtherKindError:
            continue
        if found.dtype.names and len(found.shape) == 1:
            tables[name] = list(found.dtype.names)
        elif len(found.shape) == 1 and found.dtype.kind != "V":
            named.append(name)
        elif len(found.shape) == 2 and 4 <= found.shape[1] <= _MAX_COLUMNS:
            tables[name] = None
    places = named_columns(named, columns)
    by_order = bool(columns) and "=" not in columns
    if places is not None and not (by_order and tables):
        arrays = tuple(named[place] for place in places[0])
        return arrays, list(FIELDS) if columns else list(arrays)
    if len(tables) > 1:
        tables = {name: fields for name, fields in tables.items() if name == "events"}
    if len(tables) != 1:
        there = ", ".join(archive.arrays)
        raise NotARecordingError(
            f"it needs arrays t, x, y, p, or --columns t=NAME,x=NAME,y=NAME,p=NAME; it has "
            f"{there[:80] or 'none'}"
        )
    ((name, fields),) = tables.items()
    return (name,), fields


def _pieces(archive: Arrays, arrays: tuple[str, ...]) -> Iterator[list[np.ndarray[Any, Any]]]:
    """For each piece, (n,) the values of each column, n > 0."""
    readers = [archive.column(name, "iufbV", None) for name in arrays]
    if len({reader.shape[0] for reader in readers}) > 1:
        raise NotARecordingError(f"{', '.join(arrays)} are not of one length")
    while readers[0].left:
        parts = [reader.read(_PIECE_EVENTS) for reader in readers]
        if len(parts) > 1:
            yield parts
        elif parts[0].dtype.names:
            yield [parts[0][name] for name in parts[0].dtype.names]
        else:
            yield list(parts[0].T)
