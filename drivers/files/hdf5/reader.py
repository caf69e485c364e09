"""Hdf5File: events of DSEC's files, rpg's (ts, xs, ys, ps) and Metavision's; and their repair."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.hdf5.library import (
    ECF_FILTER,
    MAX_PIECE_BYTES,
    OutsideError,
    filters,
    load,
    opened,
    own,
    value,
)
from evs.drivers.files.hdf5.recorder import CD_DTYPE, METAVISION, STREAM, WHOLE
from evs.drivers.files.hdf5.superblock import BYTES, unmarked
from evs.drivers.files.header_text import stream_from_json
from evs.drivers.files.integrity import MAX_STAMP_US, IntegrityReport, Repair, on_sensor
from evs.drivers.files.paths import existing, target_error
from evs.drivers.files.recording_file import EventOnlyFile
from evs.drivers.files.time_order import EventSorter
from evs.msgs import Events, EvsError, StreamInfo, make_events
from evs.msgs.codecs.ecf import decode_ecf

LAYOUTS = {"DSEC": ("t", "x", "y", "p"), "rpg": ("ts", "xs", "ys", "ps")}
"""layout -> names of the data sets of time, x, y, polarity in the group `events`"""

_PIECE = 1 << 18
_HEAD_BYTES = 1 << 20
_GEOMETRY = re.compile(rb"(?=(.{8})(\d{1,5})x(\d{1,5}))", re.DOTALL)
_MAX_RATIO = 1100
"""deflate expands at most 1032 times; a data set that states more is corrupt"""


@dataclass
class Hdf5File(EventOnlyFile):
    """An HDF5 file, opened with `Hdf5File.at(path)`; events are read piece by piece."""

    columns: tuple[str, ...] = LAYOUTS["DSEC"]
    """names of its data sets; none: Metavision's layout"""
    events_there: int = 0
    lacking: int = 0
    """rows after them that some columns lack, as a kill may leave them"""
    offset_us: int = 0
    external_triggers: int = 0
    """of Metavision's layout; not read"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> Hdf5File:
        """Open a file and check its data sets. EvsError: no such file, no h5py, not a recording."""
        found = existing(path)
        load()
        try:
            with opened(found) as file:
                columns, count, lacking, compression = _columns(file, found)
                offset = value(file, "t_offset", found)
                offset_us = 0 if offset is None else int(np.ravel(offset)[0])
                stream, stated = _stream(file, found)
                triggers = None if columns else own(file, "EXT_TRIGGER/events")
                trigger_count = getattr(triggers, "size", None) or 0
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
            external_triggers=trigger_count,
        )
        with found.open("rb") as begin:
            recording.unfinished = unmarked(begin.read(BYTES), recording.size) is not None
        if not stated:
            recording._find_size()
        return recording

    @property
    def format_name(self) -> str:
        """Its format in the table: endings do not decide."""
        return "hdf5" if self.columns else "metavision"

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
        if self.external_triggers:
            self.left_out = {"external triggers": self.external_triggers}

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
            group = own(file, "events" if self.columns else METAVISION)
            chunks = {} if self.columns else _encoded_chunks(group)
            step = group.chunks[0] if chunks else _PIECE
            for begin in range(0, self.events_there, step):
                rows = slice(begin, min(begin + step, self.events_there))
                try:
                    if self.columns:
                        t, x, y, p = (own(group, name)[rows] for name in self.columns)
                    else:
                        found = _chunk(self.path, chunks, rows) if chunks else group[rows]
                        t, x, y, p = (found[name] for name in "txyp")
                    piece, bad = _piece(t, x, y, p, self.offset_us)
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


def _columns(file: Any, raw: Path) -> tuple[tuple[str, ...], int, int, str]:
    """Names of the data sets, number of events, rows after them, compression."""
    one = own(file, METAVISION)
    if one is not None:
        return (), *_check_compound(file, one, raw)
    group = own(file, "events")
    for names in LAYOUTS.values():
        if group is not None and hasattr(group, "keys") and set(names) <= set(group.keys()):
            sets = [own(group, name) for name in names]
            break
    else:
        known = " or ".join(", ".join(names) for names in LAYOUTS.values())
        raise OutsideError(f"it needs a group 'events' with {known}, or {METAVISION}")
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
        count = max(0, min(count, int(value(file, WHOLE, raw))))
    return names, count, max(lengths) - count, sets[0].compression or "none"


def _check_compound(file: Any, one: Any, raw: Path) -> tuple[int, int, str]:
    """The same of Metavision's data set: number of events, rows after them, compression."""
    if getattr(one, "ndim", -1) != 1 or not set("txyp") <= set(one.dtype.names or ()):
        raise OutsideError(f"{METAVISION} has no x, y, p, t")
    if any(one.dtype[name].kind not in "iu" for name in "txyp"):
        raise OutsideError(f"{METAVISION} has no numbers for x, y, p, t")
    if one.nbytes > _MAX_RATIO * (one.id.get_storage_size() + 64):
        raise OutsideError(f"{METAVISION} states {one.nbytes} bytes, which cannot be in it")
    used = filters(one)
    if ECF_FILTER in used and (len(used) > 1 or one.dtype != CD_DTYPE):
        raise OutsideError(f"{METAVISION} has filters in addition to ECF, which are not read")
    if ECF_FILTER in used and -(-len(one) // one.chunks[0]) > one.id.get_storage_size() // 12:
        raise OutsideError(f"{METAVISION} states {len(one)} events, which cannot be in it")
    count = len(one)
    with suppress(Exception):
        count = max(0, min(count, int(value(file, WHOLE, raw))))
    compression = "ecf" if ECF_FILTER in used else one.compression or "none"
    return count, len(one) - count, compression


def _stream(file: Any, raw: Path) -> tuple[StreamInfo, bool]:
    """The stream, and whether the file states the sensor's size."""
    stated, sides = None, None
    with suppress(Exception):
        stated = json.loads(value(file, STREAM, raw))
    with suppress(Exception):
        height, width = (int(side) for side in file.attrs["sensor_resolution"])
        sides = (width, height) if 0 < min(width, height) <= max(width, height) < 1 << 15 else None
    with suppress(Exception):
        sides = sides or _geometry(raw)
    plain = StreamInfo(*(sides or (0, 0)), sensor="unknown")
    stream = dataclasses.replace(
        stream_from_json(stated, plain), frames=False, imu=False, triggers=False
    )
    return stream, stream.width > 0


def _geometry(raw: Path) -> tuple[int, int] | None:
    """The text of Metavision's attribute `geometry`, such as 1280x720, where the file has it.

    HDF5 would reserve whatever length the file states for it. Texts lie in heaps (GCOL), each after
    its length as uint64.
    """
    with raw.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if b"geometry\0" in head and b"GCOL" in head:
        for text in _GEOMETRY.finditer(head):
            width, height = int(text[2]), int(text[3])
            size = int.from_bytes(text[1], "little")
            if size == len(text[2]) + len(text[3]) + 1 and min(width, height) > 0:
                return (width, height) if max(width, height) < 1 << 15 else None
    return None


def _encoded_chunks(one: Any) -> dict[int, Any]:
    """Where chunks of ECF lie, by their first row; empty where HDF5 itself decodes the data set."""
    found: dict[int, Any] = {}
    if ECF_FILTER in filters(one):
        one.id.chunk_iter(lambda info: found.__setitem__(info.chunk_offset[0], info))
    return found


def _chunk(raw: Path, chunks: dict[int, Any], rows: slice) -> Any:
    """Rows of one chunk of the file `raw`: an array with fields t, x, y, p."""
    if rows.start not in chunks:
        raise OutsideError("a chunk is missing")
    info = chunks[rows.start]
    with raw.open("rb") as file:
        file.seek(info.byte_offset)
        data = file.read(min(info.size, MAX_PIECE_BYTES))
    # a writer without the filter leaves it out, as HDF5 permits
    found: Any = np.frombuffer(data, CD_DTYPE) if info.filter_mask & 1 else decode_ecf(data)
    if len(found) < rows.stop - rows.start:
        raise OutsideError(f"a chunk has {len(found)} events, not {rows.stop - rows.start}")
    return found[: rows.stop - rows.start]


def _piece(t: Any, x: Any, y: Any, p: Any, offset_us: int) -> tuple[Events, int]:
    """Some rows as events, and how many of the rows cannot be events."""
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
