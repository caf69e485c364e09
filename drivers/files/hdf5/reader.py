"""Hdf5File: events of DSEC's files, rpg's (ts, xs, ys, ps) and Metavision's; and their repair."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.hdf5.apart import ApartFile, CrashError, DataSet, Group, opened
from evs.drivers.files.hdf5.contents import MAX_PIECE_BYTES, OutsideError
from evs.drivers.files.hdf5.library import ECF_FILTER, check_installed
from evs.drivers.files.hdf5.recorder import CD_DTYPE, METAVISION, STREAM, WHOLE
from evs.drivers.files.hdf5.superblock import BYTES, unmarked
from evs.drivers.files.header_text import stream_from_json
from evs.drivers.files.integrity import MAX_STAMP_US, IntegrityReport, Repair, on_sensor
from evs.drivers.files.layouts import (
    FIELDS,
    LAYOUTS,
    SAMPLE,
    Table,
    decide,
    events_of,
    layout_of,
    named_columns,
    states_too_much,
)
from evs.drivers.files.paths import existing, target_error
from evs.drivers.files.recording_file import EventOnlyFile, choose_stream, of_stream
from evs.drivers.files.time_order import EventSorter
from evs.msgs import Events, EvsError, StreamInfo
from evs.msgs.codecs.ecf import decode_ecf

PATHS = tuple(dict.fromkeys(one.path for one in LAYOUTS if one.path is not None))
"""where events may lie: groups of columns, or data sets of rows"""

_PIECE = 1 << 18
_HEAD_BYTES = 1 << 20
_MAX_COLUMNS = 16
_GEOMETRY = re.compile(rb"(?=(.{8})(\d{1,5})x(\d{1,5}))", re.DOTALL)
_MAX_RATIO = 1100
"""deflate expands at most 1032 times; a data set that states more is corrupt"""

_LEFT, _RIGHT = "/left", "/right"
"""in the paths of stereo cameras"""


@dataclass(frozen=True)
class Source:
    """Where the events of a file are."""

    path: str
    """of a group, or of a data set"""
    columns: tuple[str, ...] = ()
    """names of the group's data sets of t, x, y, p; none: the data set has all of them"""
    fields: tuple[str, ...] = ()
    """names of the data set's fields; none: it has columns without names"""
    count: int = 0
    """events that are whole"""
    lacking: int = 0
    """rows after them that some columns lack, as a kill may leave them"""
    compression: str = "none"
    encoded_chunk: int = 0
    """events of a chunk that is ECF; 0: HDF5 itself decodes the data set"""


Chunks = dict[int, tuple[int, int, int]]
"""first row -> place in the file, bytes and filter mask"""


@dataclass
class Hdf5File(EventOnlyFile):
    """An HDF5 file, opened with `Hdf5File.at(path)`; events are read piece by piece."""

    source: Source = field(default_factory=lambda: Source(METAVISION))
    table: Table = field(default_factory=lambda: Table((0, 1, 2, 3), "us", ""))
    offset_us: int = 0
    external_triggers: int = 0
    """of Metavision's layout; not read"""
    others: dict[str, int] = field(default_factory=dict)
    """events of other streams: what they are -> how many"""

    @classmethod
    def at(
        cls,
        path: str | os.PathLike[str],
        columns: str = "",
        unit: str = "",
        stream: str | int | None = None,
    ) -> Hdf5File:
        """Open a file and check its data sets.

        Args:
            path: The file.
            columns: What its columns hold, as `layouts.named_columns` reads it.
            unit: Of its times.
            stream: Of two cameras, the one that is read.

        Raises:
            EvsError: No such file, no h5py, not a recording, or it is not clear what it holds.
        """
        found = existing(path)
        check_installed()
        recording = cls(found, StreamInfo(0, 0), found.stat().st_size)
        try:
            with opened(found) as file:
                stated = recording._probe(file, columns, unit, stream)
        except OutsideError as reason:
            raise EvsError(f"{found} is not a recording: {reason}") from None
        except EvsError:
            raise
        except Exception as reason:  # damaged bytes make h5py raise a dozen kinds
            text = (str(reason) or type(reason).__name__).splitlines()[0]
            raise EvsError(f"cannot read {found}: {text}") from None
        with found.open("rb") as begin:
            recording.unfinished = unmarked(begin.read(BYTES), recording.size) is not None
        if not stated:
            recording._find_size()
        return recording

    def _probe(self, file: ApartFile, columns: str, unit: str, stream: str | int | None) -> bool:
        """Find the events and the stream; whether the file states the sensor's size."""
        sources = _sources(file, columns)
        names = {path: path.split("/")[1] for path in sources if len(sources) > 1}
        self.streams = choose_stream(self.path, names, stream)
        chosen = next(iter(self.streams), next(iter(sources)))
        found = {path: sources[path]() for path in {chosen: None, **self.streams}}
        self.source = found.pop(chosen)
        self.others = {
            of_stream("events", path, names[path]): one.count for path, one in found.items()
        }
        self.compression = self.source.compression
        offset_us = int(file.value("t_offset") or 0)
        self.offset_us = offset_us if abs(offset_us) < MAX_STAMP_US else 0
        self.stream, stated = _stream(file, self.path, chosen)
        if self.source.path == METAVISION:
            triggers = file.describe("EXT_TRIGGER/events")
            self.external_triggers = triggers.size if isinstance(triggers, DataSet) else 0
        elif self.source.count and (STREAM not in file.names() or columns or unit):
            sample = self._rows(file, {}, slice(0, min(SAMPLE, self.source.count)))
            own_names = self.source.columns or self.source.fields
            group = file.describe(chosen)
            beside = [*file.names(), *(group if isinstance(group, Mapping) else ())]
            # data sets that the user named are in the order of t, x, y, p
            chosen_by_user = bool(self.source.columns and columns)
            self.table = decide(
                self.path,
                sample,
                (FIELDS if chosen_by_user else own_names) or None,
                columns="" if self.source.columns else columns,
                unit=unit,
                layout=None if columns else layout_of(own_names, chosen, beside),
            )
            self.read_as = self.table.read_as
        return stated

    @property
    def format_name(self) -> str:
        """Its format in the table: endings do not decide."""
        return "metavision" if self.source.path == METAVISION else "hdf5"

    def events(self) -> Iterator[Events]:
        """The events of each tick (1 ms where the file states none) that has any."""
        integrity = IntegrityReport(noun="events", place_unit="event")
        sorter = EventSorter(integrity, self.stream)
        for at, piece in self._pieces(integrity):
            yield from sorter.feed(piece, at + np.arange(len(piece)))
        yield from sorter.flush()
        if self.source.lacking:
            where = f"from event {self.source.count} on"
            integrity.corrupt_part(where, "not every column has them", self.source.lacking)
        self.integrity = integrity
        self.left_out = dict(self.others)
        if self.external_triggers:
            self.left_out["external triggers"] = self.external_triggers

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
        count = self.source.count
        with opened(self.path) as file:
            chunks, step = {}, _PIECE
            if self.source.encoded_chunk:
                chunks, step = file.chunks(self.source.path), self.source.encoded_chunk
            for begin in range(0, count, step):
                rows = slice(begin, min(begin + step, count))
                try:
                    columns = self._rows(file, chunks, rows)
                    t, x, y, p = (columns[place] for place in self.table.places)
                    piece, sound = events_of(t, x, y, p, self.table.unit)
                    bad = len(sound) - int(np.count_nonzero(sound))
                    if self.offset_us:
                        piece["t"] += self.offset_us
                except CrashError:
                    raise
                except Exception as reason:  # as above
                    stated = str(reason).splitlines()[0] if str(reason) else type(reason).__name__
                    integrity.corrupt_part(f"from event {begin} on", stated, rows.stop - begin)
                    continue
                if limited:
                    piece, outside = on_sensor(piece, width, height)
                    bad += outside
                if bad:
                    integrity.corrupt_part(
                        f"from event {begin} on", "not on the sensor, or no time or polarity", bad
                    )
                self.position = rows.stop * self.size // count
                yield begin, piece

    def _rows(self, file: ApartFile, chunks: Chunks, rows: slice) -> list[Any]:
        """Some rows of all columns: (n,) values of each."""
        source = self.source
        fields = FIELDS if source.path == METAVISION else source.fields
        if source.encoded_chunk:
            found = _chunk(self.path, chunks, rows)
            return [found[name] for name in fields]
        return list(file.rows(source.path, source.columns, fields, rows.start, rows.stop))


@contextmanager
def _optional() -> Iterator[None]:
    """Do without what a file does not state, or not as it should."""
    try:
        yield
    except CrashError:
        raise
    except Exception:
        pass


def _sources(file: ApartFile, columns: str) -> dict[str, Callable[[], Source]]:
    """Where events are: path -> checks them and counts them; left and right, or one."""
    if (one := file.describe(METAVISION)) is not None:
        return {METAVISION: partial(_check_compound, file, one)}
    for path in PATHS:
        sides = (path, path.replace(_LEFT, _RIGHT)) if _LEFT in path else (path,)
        found: dict[str, Callable[[], Source]] = {}
        for side in sides:
            one = file.describe(side)
            if isinstance(one, Mapping):
                names = [name for name in one if one[name] is not None]
                places = named_columns(names, columns if "=" in columns else "")
                if places is not None:
                    chosen = tuple(names[place] for place in places[0])
                    found[side] = partial(_check_columns, file, side, one, chosen)
            elif one and (len(one.shape) == 2 or (len(one.shape) == 1 and one.dtype.names)):
                found[side] = partial(_check_rows, side, one)
        if found:
            return found
    known = ", ".join(path or "the root" for path in PATHS)
    raise OutsideError(
        f"it needs columns t, x, y, p in one of {known}, or {METAVISION}; "
        "--columns t=NAME,x=NAME,y=NAME,p=NAME names others"
    )


def _check_columns(file: ApartFile, path: str, group: Group, names: tuple[str, ...]) -> Source:
    """The source of data sets in a group, each a column. OutsideError: they cannot be."""
    sets: list[DataSet] = []
    for name in names:
        one = group[name]
        if not isinstance(one, DataSet) or len(one.shape) != 1 or one.dtype.kind not in "iufb":
            raise OutsideError(f"{path}/{name} is no column of numbers")
        sets.append(one)
        if one.size != sets[0].size and WHOLE not in file.names():
            raise OutsideError(f"{', '.join(names)} are not of one length")
    _check_sizes(path, sets)
    lengths = [one.size for one in sets]
    count = _whole(file, min(lengths))
    return Source(path, names, (), count, max(lengths) - count, sets[0].compression)


def _check_rows(path: str, one: DataSet) -> Source:
    """The source of a data set of rows with fields, or with columns without names."""
    names = tuple(one.dtype.names or ())
    kinds = [one.dtype[name].kind for name in names] or [one.dtype.kind]
    table = len(one.shape) == 2
    wide = table and not 4 <= one.shape[1] <= _MAX_COLUMNS
    if wide or any(kind not in "iufb" for kind in kinds) or (table and names):
        raise OutsideError(f"{path} is no table of numbers")
    _check_sizes(path, [one])
    return Source(path, (), names, one.shape[0], 0, one.compression)


def _check_sizes(path: str, sets: list[DataSet]) -> None:
    """OutsideError where data sets state more than the file can hold."""
    for one in sets:
        if one.nbytes > _MAX_RATIO * (one.stored_bytes + 64):
            raise OutsideError(f"{one.name} states {one.nbytes} bytes, which cannot be in it")
    stated = sum(one.nbytes for one in sets)
    if states_too_much(stated, sum(one.stored_bytes for one in sets)):
        raise OutsideError(f"{path} states {stated} bytes, which cannot be in it")


def _whole(file: ApartFile, count: int) -> int:
    """How many of these rows are whole, as our recorders state it."""
    with _optional():
        if (stated := file.value(WHOLE)) is not None:
            return max(0, min(count, int(stated)))
    return count


def _check_compound(file: ApartFile, one: DataSet | Group) -> Source:
    """The source of Metavision's data set."""
    if not isinstance(one, DataSet) or len(one.shape) != 1:
        raise OutsideError(f"{METAVISION} has no x, y, p, t")
    if not set(FIELDS) <= set(one.dtype.names or ()):
        raise OutsideError(f"{METAVISION} has no x, y, p, t")
    if any(one.dtype[name].kind not in "iu" for name in FIELDS):
        raise OutsideError(f"{METAVISION} has no numbers for x, y, p, t")
    _check_sizes(METAVISION, [one])
    encoded = ECF_FILTER in one.filters
    if encoded and (len(one.filters) > 1 or one.dtype != CD_DTYPE):
        raise OutsideError(f"{METAVISION} has filters in addition to ECF, which are not read")
    if encoded and -(-one.size // one.chunk) > one.stored_bytes // 12:
        raise OutsideError(f"{METAVISION} states {one.size} events, which cannot be in it")
    count = _whole(file, one.size)
    compression = "ecf" if encoded else one.compression
    chunk = one.chunk if encoded else 0
    return Source(METAVISION, (), (), count, one.size - count, compression, chunk)


def _stream(file: ApartFile, raw: Path, path: str) -> tuple[StreamInfo, bool]:
    """The stream, and whether the file states the sensor's size."""
    stated, sides = None, None
    with _optional():
        stated = json.loads(str(file.value(STREAM)))
    with _optional():
        height, width = file.pair("sensor_resolution")
        sides = (width, height) if 0 < min(width, height) <= max(width, height) < 1 << 15 else None
    with _optional():
        sides = sides or _geometry(raw)
    with _optional():
        # M3ED's
        calibration = f"{path}/calib"
        resolution = file.describe(f"{calibration}/resolution")
        if sides is None and isinstance(resolution, DataSet) and resolution.shape == (2,):
            (pair,) = file.rows(calibration, ("resolution",), (), 0, 2)
            width, height = (int(side) for side in pair if resolution.dtype.kind in "iu")
            sides = (width, height) if 0 < min(width, height) < MAX_SIDE_PX else None
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


def _chunk(raw: Path, chunks: Chunks, rows: slice) -> Any:
    """Rows of one chunk of the file `raw`: an array with fields t, x, y, p."""
    if rows.start not in chunks:
        raise OutsideError("a chunk is missing")
    at, size, mask = chunks[rows.start]
    with raw.open("rb") as file:
        file.seek(at)
        data = file.read(min(size, MAX_PIECE_BYTES))
    # a writer without the filter leaves it out, as HDF5 permits
    found: Any = np.frombuffer(data, CD_DTYPE) if mask & 1 else decode_ecf(data)
    if len(found) < rows.stop - rows.start:
        raise OutsideError(f"a chunk has {len(found)} events, not {rows.stop - rows.start}")
    return found[: rows.stop - rows.start]


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
