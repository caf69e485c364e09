"""RawFile: reads RAW files of EVT2, EVT2.1 or EVT3 words, whole or damaged."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from evs.drivers.files.integrity import MAX_STAMP_US, IntegrityReport, on_sensor
from evs.drivers.files.interleaving import Interleaver, Message
from evs.drivers.files.paths import existing
from evs.drivers.files.raw.header import MAX_HEADER_BYTES, parse_header
from evs.drivers.files.recording_file import MultiStreamFile, by_tick
from evs.drivers.files.sorting import EventSorter
from evs.msgs import Events, EvsError, Triggers
from evs.msgs.codecs import decode_evt2, decode_evt3, decode_evt21

_PIECE_BYTES = 1 << 18
_NO_TIME_YET = "events before the first time stamp, or too far right for the format,"
_TRIGGER = 10
"""type of the words of external triggers, in each version"""
_MAX_WAITING = 1 << 14
_DECODERS: dict[str, tuple[Any, int]] = {
    "2.0": (decode_evt2, 4),
    "2.1": (decode_evt21, 8),
    "3.0": (decode_evt3, 2),
}
"""version -> its decoder, bytes of a word"""


@dataclass
class RawFile(MultiStreamFile):
    """A RAW file, opened with `RawFile.at(path)`. Counters are skipped."""

    version: str = ""
    """2.0, 2.1 or 3.0"""
    upper_first: bool = False
    """of EVT2.1: the upper half of each word comes first"""
    time_origin_us: int = 0
    """stamp of its time zero"""
    begin: int = 0
    """where its words begin, bytes"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> RawFile:
        """Open a file and read its header. EvsError: no such file, no header, another version."""
        found = existing(path)
        try:
            with found.open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                header = parse_header(_head(file))
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        if header.version not in _DECODERS:
            version = (
                f"is EVT {header.version[:20]!r}" if header.version else "does not name its EVT"
            )
            raise EvsError(f"{found} {version} in its header; EVT 2.0, 2.1 and 3.0 are read")
        opened = cls(
            found,
            header.stream,
            size,
            version=header.version,
            time_origin_us=header.time_origin_us,
            begin=header.size,
        )
        if header.version == "2.1":
            order = header.upper_first
            opened.upper_first = opened._is_swapped() if order is None else order
        if not opened.stream.width:
            opened._find_size()
        if not header.ours:
            opened.stream = dataclasses.replace(opened.stream, triggers=opened._has_triggers())
        return opened

    def _iterate(self, events: bool, auxiliary: bool) -> Iterator[Message]:
        """The events of each tick (1 ms where the file states none) that has any, and triggers."""
        integrity = IntegrityReport(noun="events")
        sorter, interleaver = EventSorter(integrity, self.stream), Interleaver(_MAX_WAITING)
        triggers: list[Triggers] = []
        for at, piece in self._pieces(integrity, triggers if auxiliary else None):
            while triggers:
                found = triggers.pop(0)
                found = found[np.argsort(found["t"], kind="stable")]
                for part in by_tick(found, self.stream):
                    yield from interleaver.add(int(part["t"][-1]), part)
            if events:
                for part in sorter.feed(piece, np.broadcast_to(np.int64(at), len(piece))):
                    yield from interleaver.merge(part)
        for part in sorter.flush():
            yield from interleaver.merge(part)
        yield from interleaver.flush()
        self.integrity = integrity

    def _has_triggers(self) -> bool:
        """Whether the file holds an external trigger; reads up to the first one."""
        word, places = _DECODERS[self.version][1], 2 if self.version == "2.1" else 1
        kind = f"<u{word // places}"
        with self.path.open("rb") as file:
            file.seek(self.begin)
            while data := file.read(_PIECE_BYTES):
                words = np.frombuffer(data, kind, len(data) // word * places)
                upper = words[(places == 2 and not self.upper_first) :: places]
                if (upper >> 8 * upper.itemsize - 4 == _TRIGGER).any():
                    return True
        return False

    def _is_swapped(self) -> bool:
        """Whether the first words of EVT2.1 hold the time in what should be their lower half."""
        with self.path.open("rb") as file:
            file.seek(self.begin)
            data = file.read(_PIECE_BYTES)
        halves = np.frombuffer(data, "<u4", len(data) // 8 * 2).reshape(-1, 2)
        is_time = (halves >> 28 == 8) & (halves[:, ::-1] == 0)
        usual, swapped = np.count_nonzero(is_time[:, 1]), np.count_nonzero(is_time[:, 0])
        return bool(swapped > usual)

    def _find_size(self) -> None:
        """Set the sensor's size to what the events need."""
        width = height = 0
        for _, piece in self._pieces(IntegrityReport()):
            if not len(piece):
                continue
            width = max(width, 1 + int(piece["x"].max(initial=0)))
            height = max(height, 1 + int(piece["y"].max(initial=0)))
        if not width:
            raise EvsError(f"{self.path} neither gives the size of its sensor nor holds events")
        self.stream = dataclasses.replace(self.stream, width=width, height=height)

    def _pieces(
        self, integrity: IntegrityReport, triggers: list[Triggers] | None = None
    ) -> Iterator[tuple[int, Events]]:
        """The byte offset of each piece of the file, and its events in the order recorded.

        In: triggers, a list that takes those of each piece.
        """
        decode, word = _DECODERS[self.version]
        if self.upper_first:
            decode = partial(decode, upper_first=True)
        state, at = None, self.begin
        width, height = self.stream.width or MAX_STAMP_US, self.stream.height or MAX_STAMP_US
        with self.path.open("rb") as file:
            file.seek(at)
            while data := file.read(_PIECE_BYTES):
                piece, state = decode(
                    data, state, time_origin_us=self.time_origin_us, triggers=triggers
                )
                piece, outside = on_sensor(piece, width, height)
                if outside:
                    integrity.corrupt(at, f"outside of {width} x {height} px", outside)
                yield at, piece
                at += len(data)
                self.position = at
        integrity.torn_tail(at - (at - self.begin) % word, at)
        self.left_out = {_NO_TIME_YET: state.skipped} if state is not None and state.skipped else {}


def _head(file: BinaryIO) -> bytes:
    """The first bytes of the file, as many as a header may have."""
    head = b""
    while len(head) < MAX_HEADER_BYTES:
        line = file.readline(MAX_HEADER_BYTES - len(head))
        if not line.startswith(b"%"):
            break
        head += line
        if line.split() == [b"%", b"end"]:
            break
    return head
