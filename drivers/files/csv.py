"""Text files of events: recorders of CSV and of rpg's TXT, and the reader of both.

CSV is a line of names, then `t,x,y,p` for each event, t in us. TXT has `t x y p` with t in seconds
and no header, as the Event Camera Dataset; rpg_e2vid expects a first line of width and height. The
StreamInfo lies beside them in FILE.json.
"""

from __future__ import annotations

import os
import re
import stat
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.files.appending_recorder import AppendingRecorder
from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.formats import SIZE_LINE, AnyPath
from evs.drivers.files.header_text import stream_from_header, stream_from_json
from evs.drivers.files.integrity import MAX_STAMP_US, IntegrityReport
from evs.drivers.files.layouts import NAMES, SAMPLE, Table, decide, events_of, named_columns
from evs.drivers.files.metadata_file import read_metadata, write_metadata
from evs.drivers.files.paths import existing
from evs.drivers.files.recording_file import EventOnlyFile
from evs.drivers.files.time_order import EventSorter
from evs.msgs import Events, EvsError, StreamInfo

_CHUNK_BYTES = 1 << 20
_HEAD_BYTES = 1 << 22
_MAX_LINE_BYTES = 1 << 16
_HEAD_LINES = 100
_SAMPLE_BYTES = 1 << 20
_MAX_COLUMNS = 100

_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_GEOMETRY = re.compile(rb"%\s*geometry\s*:?\s*(\d{1,5})\s*[,x]\s*(\d{1,5})$", re.IGNORECASE)
_PLAIN = b"0123456789+-.eE,\n"
_COMMENTS = (b"#", b"%")
_QUOTES = b"\"'"
_MARKS = ((b"\xef\xbb\xbf", 1, 0), (b"\xff\xfe", 2, 0), (b"\xfe\xff", 2, 1))
"""byte-order mark, bytes of a character, which of them holds ASCII: UTF-8, UTF-16"""
_OURS = Table((0, 1, 2, 3), "us", "")
_BOOLEANS = {b"true": b"1", b"false": b"0"}

Numbers = npt.NDArray[np.float64] | npt.NDArray[np.int64]
Offsets = npt.NDArray[np.int64]


def _plain(word: bytes) -> bytes:
    """A word without blanks and quotes around it."""
    return word.strip().strip(_QUOTES)


class _TextRecorder(AppendingRecorder):
    """The base of the recorders; the metadata file is written before the first event."""

    def _start_file(self, path: Path) -> None:
        super()._start_file(path)
        assert self._file is not None
        # a device has nothing beside it
        if stat.S_ISREG(os.fstat(self._file.fileno()).st_mode):
            try:
                write_metadata(path, self.stream)
            except EvsError:
                self._file.close()
                self._file = None
                raise


class CsvRecorder(_TextRecorder):
    """A Sink that writes CSV: `pandas.read_csv(file)` reads it."""

    NAME = "csv"

    def _header(self, stream: StreamInfo) -> bytes:  # noqa: ARG002 - it lies beside the file
        return b"t,x,y,p\n"

    def _encode(self, events: Events) -> bytes:
        columns = np.stack([events[name].astype(np.int64) for name in "txyp"], axis=1)
        # one format for all lines: several times as fast as a line at a time
        return (("%d,%d,%d,%d\n" * len(events)) % tuple(columns.ravel().tolist())).encode()


class TxtRecorder(_TextRecorder):
    """A Sink that writes the text files of rpg's tools: `numpy.loadtxt(file)` reads it."""

    NAME = "txt"

    def _header(self, stream: StreamInfo) -> bytes:  # noqa: ARG002 - it lies beside the file
        return b""

    def _encode(self, events: Events) -> bytes:
        seconds, us = np.divmod(events["t"], 1_000_000)
        columns = [seconds, us, *(events[name].astype(np.int64) for name in "xyp")]
        numbers = np.stack(columns, axis=1).ravel().tolist()
        return (("%d.%06d %d %d %d\n" * len(events)) % tuple(numbers)).encode()


class E2vidRecorder(TxtRecorder):
    """The same after a line of width and height."""

    NAME = "e2vid"

    def _header(self, stream: StreamInfo) -> bytes:
        return f"{stream.width} {stream.height}\n".encode()


@dataclass
class CsvFile(EventOnlyFile):
    """A text file of events, of evs or of others, with four columns or more.

    `layouts.py` decides what they hold. They are parted by commas, semicolons, tabs or blanks, and
    may be quoted. Lines that begin with # or % are comments; OpenEB's `%geometry:W,H` and a first
    line of two numbers are the width and height of the sensor. UTF-16 is read as its low bytes.
    """

    lines_at: int = 0
    """where the events begin, bytes of the text"""
    columns: int = 4
    delimiter: bytes = b","
    """separator; empty: blanks and tabs"""
    table: Table = _OURS
    text_at: int = 0
    """where the text begins: bytes of its byte-order mark"""
    char_bytes: int = 1
    low_byte: int = 0
    """of each character, the byte that counts"""

    @classmethod
    def at(cls, path: AnyPath, columns: str = "", unit: str = "") -> CsvFile:
        """Open a file and read its first lines.

        Args:
            path: The file.
            columns: What its columns hold, as `layouts.named_columns` reads it.
            unit: Of its times.

        Raises:
            EvsError: No such file, not a text of numbers, or it is not clear what they are.
        """
        found = existing(path)
        try:
            with found.open("rb") as file:
                data = file.read(_HEAD_BYTES)
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        opened = cls(
            path=found, stream=StreamInfo(0, 0, sensor="unknown"), size=found.stat().st_size
        )
        for mark, char_bytes, low_byte in _MARKS:
            if data.startswith(mark):
                opened.text_at, opened.char_bytes, opened.low_byte = len(mark), char_bytes, low_byte
                data = data[len(mark) :][low_byte::char_bytes]
                break
        opened._probe(data, columns, unit)
        opened.read_as = opened.table.read_as
        if not (opened.stream.width and opened.stream.height):
            width, height = opened._sensor_size()
            opened.stream = replace(opened.stream, width=width, height=height)
        return opened

    def events(self) -> Iterator[Events]:
        """The events of each tick; lines that are not events are reported as damaged."""
        integrity = IntegrityReport(noun="lines")
        sorter, stream = EventSorter(integrity, self.stream), self.stream
        for values, offsets in self._chunks(integrity):
            t, x, y, p = (values[:, place] for place in self.table.places)
            # what lies outside of the sensor is no event either
            x = np.where(x < stream.width, x, -1)
            y = np.where(y < stream.height, y, -1)
            events, sound = events_of(t, x, y, p, self.table.unit)
            if not sound.all():
                first = int((~sound).argmax())
                row = ", ".join(f"{values[first, place]:g}" for place in self.table.places)
                stated = f"an event at t, x, y, p = {row} is outside the sensor of "
                stated += f"{stream.width} x {stream.height} px, or its time or polarity cannot be"
                integrity.corrupt(int(offsets[first]), stated, int(np.count_nonzero(~sound)))
            yield from sorter.feed(events, offsets[sound])
        yield from sorter.flush()
        self.integrity = integrity

    def _probe(self, data: bytes, columns: str, unit: str) -> None:
        """Read comments and the names of columns, and decide the columns by the first events."""
        stated = read_metadata(self.path)
        at, begun, names = 0, bool(stated), None
        for line in islice(BytesIO(data), _HEAD_LINES):
            text = line.strip()
            if size := _GEOMETRY.match(text):
                self._state_size(int(size[1]), int(size[2]))
            elif not self.stream.width and (size := SIZE_LINE.fullmatch(line)):
                self._state_size(int(size[1]), int(size[2]))
                begun = True
            elif text and text[:1] not in _COMMENTS:
                if len(text) > _MAX_LINE_BYTES:
                    raise EvsError(
                        f"{self.path} is not a recording: a line has {len(text)} bytes or more; "
                        "it needs four columns, t, x, y, p"
                    )
                self.delimiter = next((one for one in (b",", b";") if one in text), b"")
                words = [_plain(word) for word in text.split(self.delimiter or None)]
                self.columns = len(words)
                if begun and self.columns < 4 and not line.endswith(b"\n"):
                    # the recorder was killed in its first event
                    self.columns = max(4, len(names or ()))
                    break
                if _NUMBER.fullmatch(words[0]):
                    self._decide(data[at:], words, names, columns, unit, bool(stated))
                    break
                names = [word.decode(errors="replace") for word in words]
                names = self._read_names(names, columns)
                begun = True
            at += len(line)
        self.lines_at = min(at, self.size)
        self.stream = stream_from_header(stated, "") if stated else self.stream

    def _decide(
        self,
        data: bytes,
        words: list[bytes],
        names: list[str] | None,
        columns: str,
        unit: str,
        is_ours: bool,
    ) -> None:
        """Decide the columns and their unit by the first lines.

        Args:
            data: The text from the first event on.
            words: Of the first event.
            names: Of the columns; None: they have none.
            columns: The user's option.
            unit: The user's.
            is_ours: A recorder of evs wrote the file.
        """
        needed = len(names) if names else 4
        if not needed <= len(words) <= _MAX_COLUMNS:
            raise EvsError(
                f"{self.path} is not a recording: a line has {len(words)} columns; "
                f"it needs {needed}: t, x, y, p"
            )
        if is_ours and not columns and not unit:
            self.table = replace(_OURS, unit="s" if b"." in words[0] else "us")
            return
        part = data[:_SAMPLE_BYTES]
        whole = part[: part.rfind(b"\n") + 1] or part
        values, _ = self._parse_block(whole, 0, IntegrityReport())
        sample = [values[:SAMPLE, k] for k in range(self.columns)]
        found = named_columns(names, columns) if names else None
        t, x = (words[k].lower() for k in (found[0] if found else (0, 1))[:2])
        with_point = (b"." in t or b"e" in t) and not (b"." in x or b"e" in x)
        self.table = decide(
            self.path, sample, names, columns=columns, unit=unit, with_point=with_point
        )

    def _read_names(self, words: list[str], columns: str) -> list[str]:
        """The names of columns, and the sensor's size, which faery states too: x@346."""
        parts = [word.partition("@") for word in words]
        names = [name for name, _, _ in parts]
        if named_columns(names, columns) is None:
            raise EvsError(
                f"{self.path} is not a recording: its first line is {' '.join(words)[:60]!r}; it "
                "needs columns t, x, y, p, or --columns t=NAME,x=NAME,y=NAME,p=NAME"
            )
        sizes = {NAMES.get(name.lower()): size for name, _, size in parts if size.isdecimal()}
        if {"x", "y"} <= set(sizes) and len(sizes["x"] + sizes["y"]) < 12:
            self._state_size(int(sizes["x"]), int(sizes["y"]))
        return names

    def _state_size(self, width: int, height: int) -> None:
        """Take the sensor's size from the file, where it is possible."""
        stated = {"width": width, "height": height}
        self.stream = stream_from_json(stated, StreamInfo(0, 0, sensor="unknown"))

    def _chunks(self, integrity: IntegrityReport) -> Iterator[tuple[Numbers, Offsets]]:
        """For each part of the file: (n, columns) numbers, (n,) byte offsets of their lines."""
        with self.path.open("rb") as file:
            at, rest = self.lines_at, b""
            file.seek(self._offset(at))
            while True:
                chunk = file.read(_CHUNK_BYTES)[self.low_byte :: self.char_bytes]
                data = rest + chunk
                end = data.rfind(b"\n") + 1
                if not chunk and data and not end:
                    # the last line has no end: whole, or torn
                    if data[:1] not in _COMMENTS and self._parse_line(data) is None:
                        integrity.torn_tail(self._offset(at), self._offset(at + len(data)))
                        return
                    end = len(data)
                elif not end and len(data) > _MAX_LINE_BYTES:
                    end = len(data)
                if end:
                    self.position = self._offset(at)
                    yield self._parse_block(data[:end], at, integrity)
                at, rest = at + end, data[end:]
                if not chunk and not rest:
                    return

    def _offset(self, at: Any) -> Any:
        """The place in the file of a place in the text, bytes."""
        return self.text_at + self.char_bytes * at

    def _parse_block(
        self, text: bytes, at: int, integrity: IntegrityReport
    ) -> tuple[Numbers, Offsets]:
        """The numbers of whole lines, their byte offsets; other lines are reported as damaged."""
        parting = self.delimiter or b" \t"
        table = bytes.maketrans(parting, b"," * len(parting))
        plain = text.translate(table, _QUOTES + (b"\r " if self.delimiter else b"\r"))
        plain = plain if plain.endswith(b"\n") else plain + b"\n"
        codes = np.frombuffer(plain, np.uint8)
        ends = np.flatnonzero(codes == 10)
        commas = np.diff(np.cumsum(codes == 44, dtype=np.int32)[ends], prepend=0)
        if (commas == self.columns - 1).all() and not plain.translate(None, _PLAIN):
            values = _parse_numbers(plain, len(ends) * self.columns)
            if values is not None:
                breaks = np.flatnonzero(np.frombuffer(text, np.uint8) == 10)[: len(ends) - 1]
                offsets = at + np.concatenate([np.zeros(1, np.int64), breaks + 1])
                return values.reshape(-1, self.columns), self._offset(offsets)
        return self._parse_lines(text, at, integrity)

    def _parse_lines(
        self, text: bytes, at: int, integrity: IntegrityReport
    ) -> tuple[Numbers, Offsets]:
        """The slow way, line by line, for a part that is not plain numbers."""
        rows, offsets = [], []
        for line in text.split(b"\n"):
            row = self._parse_line(line)
            if row is not None:
                rows.append(row)
                offsets.append(self._offset(at))
            elif line.strip() and line[:1] not in _COMMENTS:
                integrity.corrupt(self._offset(at), f"{line[:40]!r} is not {self.columns} numbers")
            at += len(line) + 1
        return np.array(rows).reshape(-1, self.columns), np.array(offsets, np.int64)

    def _parse_line(self, line: bytes) -> list[int | float] | None:
        """The numbers of one line; None if it is not an event."""
        if self.delimiter and line.count(self.delimiter) != self.columns - 1:
            return None
        words = line.split(self.delimiter or None, self.columns)
        row: list[int | float] = []
        for word in words:
            plain = _plain(word)
            plain = _BOOLEANS.get(plain.lower(), plain)
            if not _NUMBER.fullmatch(plain) or len(plain) > 32:
                return None
            number = int(plain) if plain.lstrip(b"+-").isdigit() else float(plain)
            row.append(number if abs(number) <= MAX_STAMP_US else 2 * MAX_STAMP_US - 1)
        return row if len(row) == self.columns else None

    def _sensor_size(self) -> tuple[int, int]:
        """The width and height, px, that the events need."""
        most = [0, 0]
        for values, _ in self._chunks(IntegrityReport()):
            for axis in (0, 1):
                column = values[:, self.table.places[1 + axis]]
                fits = column[(column >= 0) & (column < MAX_SIDE_PX)]
                most[axis] = max(most[axis], int(fits.max(initial=0)))
        return most[0] + 1, most[1] + 1


def _parse_numbers(plain: bytes, count: int) -> Numbers | None:
    """The numbers between commas and line ends; None if there are not `count` of them."""
    is_float = any(mark in plain for mark in (b".", b"e", b"E"))
    flat = plain.replace(b"\n", b",").decode("ascii")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            kind: type[Any] = np.float64 if is_float else np.int64
            values: Numbers = np.fromstring(flat, kind, sep=",")
    except (ValueError, DeprecationWarning):
        return None
    return values if len(values) == count else None
