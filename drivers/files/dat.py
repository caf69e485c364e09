"""DAT files of Prophesee's software, 8 bytes an event: recorder and reader."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.drivers.files.appending_recorder import AppendingRecorder
from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.header_text import (
    json_object,
    percent_lines,
    read_file_head,
    stream_from_header,
    stream_json,
)
from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.recording_file import EventOnlyFile
from evs.drivers.files.time_order import in_order
from evs.msgs import Events, EvsError, StreamInfo
from evs.msgs.codecs import DatState, decode_dat, encode_dat
from evs.msgs.codecs.dat import WRAP_US

STREAM, START = "evs_stream", "evs_start_us"
CHANGE_EVENTS, EVENT_BYTES = 0x0C, 8
"""The two bytes between the header's lines and the events."""


class DatRecorder(AppendingRecorder):
    """A Sink that writes DAT, version 2; the StreamInfo is a line of the header.

    The clock of a stream that begins too late for it counts from there; another line says so, and
    our reader adds it.
    """

    NAME = "dat"

    def _header(self, stream: StreamInfo) -> bytes:
        self._after_us = 0
        self._origin_us = stream.start_us if stream.start_us >= WRAP_US else 0
        lines = {
            "Version": "2",
            "Width": str(stream.width),
            "Height": str(stream.height),
            START: str(self._origin_us),
            STREAM: stream_json(stream),
        }
        text = "".join(f"% {key} {value}\n" for key, value in lines.items())
        return text.encode() + bytes([CHANGE_EVENTS, EVENT_BYTES])

    def _encode(self, events: Events) -> bytes:
        if self._origin_us:
            events = events.copy()
            events["t"] -= self._origin_us
        first_us = int(events["t"][0])
        if first_us < self._after_us:
            raise EvsError(
                f"{self._path}: events at {first_us} us come after {self._after_us} us, and DAT "
                "has no way back in time; record to .aedat4"
            )
        # a reader sees a wrap only where the stamp falls: never at the begin, or a wrap later
        stamps = events["t"]
        longest = max(first_us - self._after_us, int((stamps[1:] - stamps[:-1]).max(initial=0)))
        if longest >= WRAP_US:
            raise EvsError(
                f"cannot record nothing for {longest} us to {self._path}: DAT needs an event "
                "every 4294 s; record to .aedat4"
            )
        data = encode_dat(events, after_us=self._after_us)
        self._after_us = int(stamps[-1])
        return data


_PIECE_BYTES = 1 << 20
_KINDS = {0x00: "change events", CHANGE_EVENTS: "change events", 0x0E: "trigger events"}
_VERSIONS = ("1", "2")


@dataclass
class DatFile(EventOnlyFile):
    """A DAT file, opened with `DatFile.at(path)`."""

    begin: int = 0
    """where its events begin, bytes"""
    version: int = 2
    every_fall_wraps: bool = False
    """whether evs recorded it, which means that each fall of the time is a wrap"""
    start_us: int = 0
    """start of its clock, us"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> DatFile:
        """Open a file and read its header. EvsError: no such file, not a DAT file of CD events."""
        found, head = read_file_head(path)
        lines, begin = percent_lines(head)
        kinds = head[begin : begin + 2]
        if not lines or len(kinds) < 2:
            raise EvsError(f"{found} is not a readable DAT file: it has no header of lines with %")
        version = lines.get("version", "2")
        if version not in _VERSIONS:
            raise EvsError(f"{found} is of DAT version {version[:20]!r}; 1 and 2 are read")
        if kinds[1] != EVENT_BYTES or _KINDS.get(kinds[0]) != "change events":
            what = _KINDS.get(kinds[0], f"events of kind {kinds[0]}")
            raise EvsError(f"{found} holds no change events but {what} of {kinds[1]} bytes")
        stated = json_object(lines[STREAM]) if STREAM in lines else None
        stream = stream_from_header(stated, "")
        opened = cls(
            found,
            stream,
            found.stat().st_size,
            begin=begin + 2,
            version=int(version),
            every_fall_wraps=stated is not None,
            start_us=_number(lines.get(START, "")),
        )
        if not stream.width:
            sides = [_side(lines.get(key, "")) for key in ("width", "height")]
            opened.stream = StreamInfo(sides[0], sides[1], sensor="unknown")
            if not all(sides):
                opened._find_size()
        return opened

    def events(self) -> Iterator[Events]:
        """The events of each tick (1 ms where the file states none) that has any."""
        integrity = IntegrityReport(noun="events")
        yield from in_order(self._pieces(), self.stream, integrity)
        integrity.torn_tail(self.size - (self.size - self.begin) % EVENT_BYTES, self.size)
        self.integrity = integrity

    def _pieces(self) -> Iterator[tuple[npt.NDArray[np.int64], Events]]:
        """Byte offsets and events of each piece of the file, in the order recorded."""
        state, at = DatState(), self.begin
        with self.path.open("rb") as file:
            file.seek(at)
            while len(data := file.read(_PIECE_BYTES)) >= EVENT_BYTES:
                piece, state = decode_dat(
                    data, state, version=self.version, ordered=self.every_fall_wraps
                )
                piece["t"] += self.start_us
                yield at + EVENT_BYTES * np.arange(len(piece)), piece
                at += len(data)
                self.position = at

    def _find_size(self) -> None:
        """Set the sensor's size to what the events need."""
        width = height = 1
        for _, piece in self._pieces():
            width = max(width, 1 + int(piece["x"].max(initial=0)))
            height = max(height, 1 + int(piece["y"].max(initial=0)))
        self.stream = dataclasses.replace(self.stream, width=width, height=height)


def _side(text: str) -> int:
    """A size in px; 0 where the text is not one."""
    return side if (side := _number(text)) <= MAX_SIDE_PX else 0


def _number(text: str) -> int:
    """An integer of at most 16 digits; 0 where the text is not one."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 17 else 0
