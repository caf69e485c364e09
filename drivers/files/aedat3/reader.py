"""Aedat3File: reads AEDAT3.1 files as events, frames and IMU samples, whole or damaged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from evs.drivers.files.aedat3.auxiliary import BadEventError, ColouredError, frames_in, samples_in
from evs.drivers.files.aedat3.compressed import FORMATS, expanded
from evs.drivers.files.aedat3.layout import (
    END,
    EVENT,
    EVS_LINE,
    FRAME,
    IMU,
    IMU9,
    MAGIC,
    MARK,
    MARK_AT,
    NUMBERS,
    OTHER_KINDS,
    OTHERS,
    POLARITY,
    SOURCE,
    Head,
    read_head,
)
from evs.drivers.files.chips import chip_named
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.header_text import own_line_and_chip, read_file_head, stream_from_header
from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.recording_file import MultiStreamFile, choose_stream, of_stream
from evs.drivers.files.time_order import EventSorter, Interleaver
from evs.msgs import Events, EvsError, Frame, ImuSamples, make_events

_CHUNK_EVENTS = 1 << 17
_CHUNK_BYTES = 1 << 20
_COLOURED = "frames that are not grey"
_UNREAD = {POLARITY: "events", FRAME: "frames", **dict.fromkeys(IMU, "IMU samples")}
"""kind of a packet of a source that is not read -> what is counted of it"""

Raw = npt.NDArray[np.void]


@dataclass
class Aedat3File(MultiStreamFile):
    """An AEDAT3.1 file, of evs, cAER or jAER."""

    packets_at: int = 0
    """where the packets begin, bytes"""
    source: int | None = None
    """number of the source that is read; None: of all, since events come from one"""
    _frames: int = field(default=0, repr=False)

    @classmethod
    def at(cls, path: AnyPath, stream: str | int | None = None) -> Aedat3File:
        """Read the header.

        Args:
            path: The file.
            stream: Number or name of the source; None: the first that has events.

        Raises:
            EvsError: No such file, not AEDAT3.1, an unknown compression, or no such source.
        """
        found, data = read_file_head(path)
        at = data.find(END)
        if not data.startswith(MAGIC) or at < 0:
            lacks = END if data.startswith(MAGIC) else MAGIC
            raise EvsError(f"{found} is not a readable AEDAT3.1 file: it has no {lacks.decode()}")
        at = data.find(b"\n", at) + 1 or len(data)
        lines = [line.rstrip("\r") for line in data[:at].decode(errors="replace").split("\n")]
        compression = "RAW"
        for line in lines:
            form = line.removeprefix("#Format: ")
            compression = compression if form == line else form.strip()
        if compression not in FORMATS:
            shown = "".join(letter if letter.isprintable() else "?" for letter in compression[:40])
            raise EvsError(
                f"{found} is compressed in a way that we do not know ({shown}; known: "
                f"{', '.join(FORMATS)}): write it again as RAW"
            )
        stated, _ = own_line_and_chip(lines, EVS_LINE, SOURCE)
        opened = cls(
            path=found,
            stream=stream_from_header(stated, "", frames=True, imu=True),
            size=found.stat().st_size,
            compression="none" if compression == "RAW" else compression,
            packets_at=at,
        )
        if stated and opened.stream.width:
            opened.streams = choose_stream(found, {"1": opened.stream.camera}, stream)
        else:
            opened._probe(dict(filter(None, map(_source, lines))), stream)
        return opened

    def _iterate(self, events: bool, auxiliary: bool) -> Iterator[Events | Frame | ImuSamples]:
        """The requested messages; special events and colour frames are counted in `left_out`."""
        integrity, left_out = IntegrityReport(), dict[str, int]()
        sorter, interleaver = EventSorter(integrity, self.stream), Interleaver()
        self._frames = 0
        with self.path.open("rb") as file:
            for at, head in self._packets(file, integrity, left_out):
                if self.source is not None and head.source != self.source:
                    if events if head.kind == POLARITY else auxiliary:
                        key = str(head.source)
                        what = of_stream(_UNREAD[head.kind], key, self.streams.get(key, ""))
                        count(left_out, what, head.valid)
                elif head.kind == POLARITY:
                    if events:
                        for place, raw in self._parts(file, at, head, integrity):
                            found, where = self._events(place, head, raw, integrity, left_out)
                            for part in sorter.feed(found, where):
                                yield from interleaver.merge(part)
                elif auxiliary:
                    for t_us, message in self._auxiliary(file, at, head, integrity, left_out):
                        yield from interleaver.add(t_us, message)
        for part in sorter.flush():
            yield from interleaver.merge(part)
        yield from interleaver.flush()
        self.integrity, self.left_out = integrity, left_out

    def _packets(
        self, file: BinaryIO, integrity: IntegrityReport, left_out: dict[str, int]
    ) -> Iterator[tuple[int, Head]]:
        """(byte offset, header) of each packet that evs reads, then of a torn last one."""
        at, broken = self.packets_at, -1
        while at < self.size:
            self.position = at
            head = read_head(file, at)
            if head is None or not head.fits(at, self.size):
                broken = at if broken < 0 else broken
                at = self._next_packet(file, at + 1)
                continue
            if broken >= 0:
                integrity.corrupt(broken, "no packet begins here")
                broken = -1
            if head.kind == POLARITY or head.kind == FRAME or head.kind in IMU:
                yield at, head
            else:
                count(left_out, OTHERS.get(head.kind, OTHER_KINDS), head.number)
            at += NUMBERS.size + head.length
        if broken >= 0:
            torn = self._torn_packet_head(file, broken)
            integrity.torn_tail(
                broken if torn is None else broken + NUMBERS.size + torn.length, self.size
            )
            if torn is not None:
                yield broken, torn

    def _torn_packet_head(self, file: BinaryIO, at: int) -> Head | None:
        """The header of a torn packet, reduced to its whole events; None without any."""
        head = read_head(file, at)
        room = self.size - at - NUMBERS.size
        if head is None or not head.sound or head.compressed or head.kind not in (POLARITY, *IMU):
            return None
        whole = room // head.size
        return head._replace(number=whole, valid=0) if whole > 0 else None

    def _parts(
        self, file: BinaryIO, at: int, head: Head, integrity: IntegrityReport
    ) -> Iterator[tuple[int, Raw]]:
        """(byte offset, events) of the parts of a polarity packet."""
        place = at + NUMBERS.size
        if head.compressed:
            file.seek(place)
            raw = expanded(file.read(head.length), head.number)
            if raw is None:
                integrity.corrupt(at, f"its {head.length} bytes are no {head.number} events")
            else:
                yield place, raw
            return
        end = place + head.length
        while place < end:
            file.seek(place)
            raw = np.frombuffer(file.read(min(8 * _CHUNK_EVENTS, end - place)), EVENT)
            yield place, raw
            place += 8 * max(1, len(raw))

    def _events(
        self, at: int, head: Head, raw: Raw, integrity: IntegrityReport, left_out: dict[str, int]
    ) -> tuple[Events, npt.NDArray[np.int64]]:
        """The valid events of a part, (n,), and their byte offsets."""
        data, stream = raw["data"].astype(np.int64), self.stream
        x, y = data >> 17, data >> 2 & 0x7FFF
        valid = (data & 1).astype(np.bool_)
        count(left_out, "invalid events", int(np.count_nonzero(~valid)))
        off = valid & ((x >= stream.width) | (y >= stream.height) | (raw["stamp"] < 0))
        step = 0 if head.compressed else EVENT.itemsize
        if off.any():
            first = int(off.argmax())
            where = f"an event at ({x[first]}, {y[first]}), {raw['stamp'][first]} us,"
            wrong = f"{where} is outside the sensor or its time"
            integrity.corrupt(at + step * first, wrong, int(np.count_nonzero(off)))
            integrity.noun = "events"
        kept = np.flatnonzero(valid & ~off)
        t = (head.overflow << 31) + raw["stamp"][kept].astype(np.int64)
        return make_events(t, x[kept], y[kept], data[kept] >> 1 & 1), at + step * kept

    def _auxiliary(
        self,
        file: BinaryIO,
        at: int,
        head: Head,
        integrity: IntegrityReport,
        left_out: dict[str, int],
    ) -> Iterator[tuple[int, Frame | ImuSamples]]:
        """(time in us, message) of each frame in a packet, or of its IMU samples."""
        if head.kind != FRAME:
            file.seek(at + NUMBERS.size)
            samples, invalid, bad = samples_in(file.read(head.length), head)
            count(left_out, "invalid IMU samples", invalid)
            if head.kind == IMU9:
                count(left_out, "compass readings", len(samples))
            if bad:
                integrity.corrupt(
                    at, "an IMU sample has a value that is not finite, or no time", bad
                )
            if len(samples):
                yield int(samples["t"][-1]), samples
            return
        for found in frames_in(file, at + NUMBERS.size, head):
            if isinstance(found, ColouredError):
                count(left_out, _COLOURED, 1)
            elif isinstance(found, BadEventError):
                integrity.corrupt(at, str(found))
            elif found is None:
                count(left_out, "invalid frames", 1)
            else:
                yield found.end_us, replace(found, seq=self._frames, camera=self.stream.camera)
                self._frames += 1

    def _next_packet(self, file: BinaryIO, start: int) -> int:
        """Offset at or after `start` at which a whole packet may begin; else the end."""
        at = start
        while at + NUMBERS.size <= self.size:
            file.seek(at)
            chunk = file.read(_CHUNK_BYTES)
            for found in MARK.finditer(chunk, MARK_AT):
                begin = found.start() - MARK_AT
                if begin + NUMBERS.size > len(chunk):
                    break
                if Head(*NUMBERS.unpack_from(chunk, begin)).fits(at + begin, self.size):
                    return at + begin
            # a head that the chunk's end cuts is in the next one
            at += max(1, len(chunk) - NUMBERS.size + 1)
        return self.size

    def _probe(self, names: dict[str, str], wanted: str | int | None) -> None:
        """Find the sources of another writer's file, their streams, and their sensors' sizes.

        Args:
            names: Number -> name of the sources that the header lists.
            wanted: Number or name of the source that is read; None: the first that has events.
        """
        sides: dict[str, tuple[int, int]] = {}
        kinds: dict[str, set[int]] = {}
        with self.path.open("rb") as file:
            for at, head in self._packets(file, IntegrityReport(), {}):
                key = str(head.source)
                kinds.setdefault(key, set()).add(head.kind)
                if head.kind != POLARITY:
                    continue
                width, height = sides.setdefault(key, (1, 1))
                if chip_named(names.get(key, "")):
                    continue
                for _, raw in self._parts(file, at, head, IntegrityReport()):
                    data = raw["data"][(raw["data"] & 1).astype(np.bool_)]
                    width = max(width, 1 + int((data >> 17).max(initial=0)))
                    height = max(height, 1 + int((data >> 2 & 0x7FFF).max(initial=0)))
                sides[key] = width, height
        cameras = {key: names.get(key, "") for key in sorted(sides or kinds, key=int)}
        self.streams = choose_stream(self.path, cameras, wanted)
        key = next(iter(self.streams), "")
        self.source = int(key) if len(self.streams) > 1 else None
        name = names.get(key) or next(iter(names.values()), "")
        stream = stream_from_header(None, name)
        if not stream.width:
            width, height = sides.get(key, (1, 1))
            stream = replace(stream, width=width, height=height)
        found = kinds.get(key, set()) if self.source is not None else set().union(*kinds.values())
        imu = not found.isdisjoint(IMU)
        self.stream = replace(stream, frames=FRAME in found, imu=imu)


def _source(line: str) -> tuple[str, str] | None:
    """Number and name of a source in a header's line; None in another line."""
    number, colon, name = line.removeprefix(SOURCE).partition(":")
    stated = line.startswith(SOURCE) and colon and number.strip().isdecimal()
    return (number.strip(), name.strip()) if stated else None


def count(left_out: dict[str, int], what: str, number: int) -> None:
    """Count more of what is valid but not read."""
    if number:
        left_out[what] = left_out.get(what, 0) + number
