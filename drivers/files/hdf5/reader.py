"""Hdf5File: events of DSEC's files, of rpg's (ts, xs, ys, ps) and of ours; and their repair."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.hdf5.library import OutsideError, load, opened, own, value
from evs.drivers.files.hdf5.recorder import STREAM, WHOLE
from evs.drivers.files.hdf5.superblock import BYTES, unmarked
from evs.drivers.files.header_text import stream_from_json
from evs.drivers.files.integrity import MAX_STAMP_US, IntegrityReport, Repair, on_sensor
from evs.drivers.files.paths import existing, target_error
from evs.drivers.files.recording_file import EventOnlyFile
from evs.drivers.files.time_order import EventSorter
from evs.msgs import Events, EvsError, StreamInfo, make_events

LAYOUTS = {"DSEC": ("t", "x", "y", "p"), "rpg": ("ts", "xs", "ys", "ps")}
"""layout -> names of the data sets of time, x, y, polarity in the group `events`"""

_PIECE = 1 << 18
_MAX_RATIO = 1100
"""deflate expands at most 1032 times; a data set that states more is corrupt"""


@dataclass
class Hdf5File(EventOnlyFile):
    """An HDF5 file, opened with `Hdf5File.at(path)`; events are read piece by piece."""

    columns: tuple[str, ...] = LAYOUTS["DSEC"]
    """names of its data sets"""
    events_there: int = 0
    lacking: int = 0
    """rows after them that some columns lack, as a kill may leave them"""
    offset_us: int = 0

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> Hdf5File:
        """Open a file and check its data sets. EvsError: no such file, no h5py, not a recording."""
        found = existing(path)
        load()
        try:
            with opened(found) as file:
                columns, count, lacking, compression = _columns(file)
                offset = value(file, "t_offset")
                offset_us = 0 if offset is None else int(np.ravel(offset)[0])
                stream, stated = _stream(file)
        except OutsideError as reason:
            raise EvsError(f"{found} is not a recording: {reason}") from None
        except Exception as reason:  # damaged bytes make h5py raise a dozen kinds
            text = (str(reason) or type(reason).__name__).splitlines()[0]
            raise EvsError(f"cannot read {found}: {text}") from None
        recording = cls(
            found,
            stream,
            found.stat().st_size,
            compression,
            columns=columns,
            events_there=count,
            lacking=lacking,
            offset_us=offset_us if abs(offset_us) < MAX_STAMP_US else 0,
        )
        with found.open("rb") as begin:
            recording.unfinished = unmarked(begin.read(BYTES), recording.size) is not None
        if not stated:
            recording._find_size()
        return recording

    def events(self) -> Iterator[Events]:
        """The events of each tick (1 ms where the file states none) that has any."""
        integrity = IntegrityReport(noun="events", place_unit="event")
        sorter = EventSorter(integrity, self.stream)
        for at, piece in self._pieces(integrity):
            yield from sorter.feed(piece, at + np.arange(len(piece)))
        yield from sorter.flush()
        if self.lacking:
            where = f"from event {self.events_there} on"
            integrity.corrupt_part(where, "not every column has them", self.lacking)
        self.integrity = integrity

    def _find_size(self) -> None:
        """Set the sensor's size to what the events need."""
        width = height = 1
        for _, piece in self._pieces(IntegrityReport(), limited=False):
            width = max(width, 1 + int(piece["x"].max(initial=0)))
            height = max(height, 1 + int(piece["y"].max(initial=0)))
        self.stream = dataclasses.replace(self.stream, width=width, height=height)

    def _pieces(
        self, integrity: IntegrityReport, limited: bool = True
    ) -> Iterator[tuple[int, Events]]:
        """The index of each piece's first event, and its events."""
        width, height = self.stream.width, self.stream.height
        with opened(self.path) as file:
            group = own(file, "events")
            for begin in range(0, self.events_there, _PIECE):
                rows = slice(begin, min(begin + _PIECE, self.events_there))
                try:
                    piece, bad = _piece(group, self.columns, rows, self.offset_us)
                except Exception as reason:  # as above
                    stated = str(reason).splitlines()[0] if str(reason) else type(reason).__name__
                    integrity.corrupt_part(f"from event {begin} on", stated, rows.stop - begin)
                    continue
                if limited:
                    piece, outside = on_sensor(piece, width, height)
                    bad += outside
                if bad:
                    integrity.corrupt_part(
                        f"from event {begin} on", "not on the sensor, or no time", bad
                    )
                self.position = rows.stop * self.size // self.events_there
                yield begin, piece


def _columns(file: Any) -> tuple[tuple[str, ...], int, int, str]:
    """Names of the data sets, number of events, rows after them, compression."""
    group = own(file, "events")
    for names in LAYOUTS.values():
        if group is not None and hasattr(group, "keys") and set(names) <= set(group.keys()):
            sets = [own(group, name) for name in names]
            break
    else:
        known = " or ".join(", ".join(names) for names in LAYOUTS.values())
        raise OutsideError(f"it needs a group 'events' with {known}")
    for name, one in zip(names, sets, strict=True):
        if getattr(one, "ndim", -1) != 1 or one.dtype.kind not in "iufb":
            raise OutsideError(f"events/{name} is no column of numbers")
        if len(one) != len(sets[0]) and WHOLE not in file:
            raise OutsideError(f"{', '.join(names)} are not of one length")
        if one.nbytes > _MAX_RATIO * (one.id.get_storage_size() + 64):
            raise OutsideError(f"events/{name} states {one.nbytes} bytes, which cannot be in it")
    lengths = [len(one) for one in sets]
    count = min(lengths)
    with suppress(Exception):
        count = max(0, min(count, int(value(file, WHOLE))))
    return names, count, max(lengths) - count, sets[0].compression or "none"


def _stream(file: Any) -> tuple[StreamInfo, bool]:
    """The stream, and whether the file states the sensor's size."""
    stated, sides = None, None
    with suppress(Exception):
        stated = json.loads(value(file, STREAM))
    with suppress(Exception):
        height, width = (int(side) for side in file.attrs["sensor_resolution"])
        sides = (width, height) if 0 < min(width, height) <= max(width, height) < 1 << 15 else None
    plain = StreamInfo(*(sides or (0, 0)), sensor="unknown")
    stream = dataclasses.replace(
        stream_from_json(stated, plain), frames=False, imu=False, triggers=False
    )
    return stream, stream.width > 0


def _piece(group: Any, names: tuple[str, ...], rows: slice, offset_us: int) -> tuple[Events, int]:
    """Some rows as events, and how many of the rows cannot be events."""
    t, x, y, p = (own(group, name)[rows] for name in names)
    if t.dtype.kind == "f":
        # seconds, as rpg's tools write them
        stamps = np.rint(np.nan_to_num(t * 1e6, nan=2.0**63))
    else:
        stamps = t
    right = (stamps >= -MAX_STAMP_US) & (stamps <= MAX_STAMP_US)
    right &= (x >= 0) & (x < 1 << 15) & (y >= 0) & (y < 1 << 15)
    bad = len(right) - int(np.count_nonzero(right))
    if bad:
        stamps, x, y, p = stamps[right], x[right], y[right], p[right]
    return make_events(stamps.astype(np.int64) + offset_us, x, y, p > 0), bad


def repair(path: Path) -> Repair:
    """Clear the mark that the file is being written. EvsError: not a recording, not writable."""
    found = Hdf5File.at(path)
    try:
        with found.path.open("r+b") as file:
            mended = unmarked(file.read(BYTES), found.size)
            if mended is None:
                return Repair(found.path, 0, found.size, False)
            file.seek(0)
            file.write(mended)
    except OSError as reason:
        raise target_error(found.path, reason) from None
    return Repair(found.path, 0, found.size, False, "took back the mark that it is being written")
