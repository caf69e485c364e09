"""AEDAT3.1: cAER's and jAER's files: header lines, then packets that count the clock's wraps.

A packet is a header of 28 bytes, little-endian, and its events, 8 bytes each for polarity:

    header   i16 type (1 polarity), i16 source, i32 event's size, i32 offset of the stamp in it,
             i32 overflows of the stamps, i32 capacity, i32 events, i32 valid events
    event    u32 data: bit 0 valid, 1 polarity, 2-16 y, 17-31 x, from the upper left; i32 stamp, us

t = overflows * 2^31 + stamp.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

from evs.drivers.files.appending import AppendingRecorder
from evs.drivers.files.damage import Damage
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.header_text import said_in, stream_from, stream_json
from evs.drivers.files.ordered import InOrder
from evs.drivers.files.recorded import EventsFile
from evs.drivers.files.recording import existing
from evs.msgs import Events, EvsError, StreamInfo, make_events

MAGIC = b"#!AER-DAT3.1"
END = b"#!END-HEADER"
SAID = "#evs "
SPAN_US = 1 << 31

_POLARITY = 1
_KINDS = {0: "special events", 2: "frames", 3: "IMU samples", 4: "IMU samples"}
_KIND_OF_OTHERS = "events of other kinds"

_NUMBERS = struct.Struct("<hhiiiiii")


class _Head(NamedTuple):
    """A packet's header."""

    kind: int
    source: int
    size: int
    stamp_at: int
    overflow: int
    capacity: int
    number: int
    valid: int


_EVENT = np.dtype([("data", "<u4"), ("stamp", "<i4")])
_MARK = b"\x08\0\0\0\x04\0\0\0"
"""Size and offset of the stamp in the head of a polarity packet: what a search goes by."""

_MAX_HEADER_BYTES = 1 << 22
_CHUNK_EVENTS = 1 << 17
_CHUNK_BYTES = 1 << 20


class Aedat3Recorder(AppendingRecorder):
    """A Sink that writes AEDAT3.1; a packet that the clock's wrap lies in becomes two."""

    NAME = "aedat3"

    def _header(self, stream: StreamInfo) -> bytes:
        lines = [
            MAGIC.decode(),
            "#Format: RAW",
            f"#Source 1: {stream.sensor.upper()}",
            "#Start-Time: 1970-01-01 00:00:00 (TZ+0000)",
            SAID + stream_json(stream),
            END.decode(),
        ]
        return "".join(f"{line}\r\n" for line in lines).encode()

    def _encoded(self, events: Events) -> bytes:
        overflows = events["t"] >> 31
        cuts = np.flatnonzero(np.diff(overflows)) + 1
        return b"".join(_packet(part) for part in np.split(events, cuts))


def _packet(events: Events) -> bytes:
    """One packet of events, (n,), between two wraps."""
    count = len(events)
    overflow = int(events["t"][0]) >> 31
    head = _Head(_POLARITY, 1, _EVENT.itemsize, 4, overflow, count, count, count)
    body = np.empty(count, _EVENT)
    x, y = events["x"].astype(np.uint32), events["y"].astype(np.uint32)
    body["data"] = x << 17 | y << 2 | (events["p"] != 0).astype(np.uint32) << 1 | 1
    body["stamp"] = events["t"] & (SPAN_US - 1)
    return _NUMBERS.pack(*head) + body.tobytes()


@dataclass
class Aedat3File(EventsFile):
    """One AEDAT3.1 file, ours, cAER's or jAER's."""

    packets_at: int = 0
    """where the packets begin, bytes"""

    @classmethod
    def at(cls, path: AnyPath) -> Aedat3File:
        """Read the header. EvsError: no such file, not AEDAT3.1, compressed."""
        found = existing(path)
        try:
            with found.open("rb") as file:
                data = file.read(_MAX_HEADER_BYTES)
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        at = data.find(END)
        if not data.startswith(MAGIC) or at < 0:
            lacks = END if data.startswith(MAGIC) else MAGIC
            raise EvsError(f"{found} is not a readable AEDAT3.1 file: it has no {lacks.decode()}")
        at = data.find(b"\n", at) + 1 or len(data)
        lines = [line.rstrip("\r") for line in data[:at].decode(errors="replace").split("\n")]
        for line in lines:
            form = line.removeprefix("#Format: ")
            if form != line and form.strip() != "RAW":
                raise EvsError(
                    f"{found} is compressed ({form.strip()[:40]}), which we do not read: "
                    "write it again as RAW"
                )
        ours = [line.removeprefix(SAID) for line in lines if line.startswith(SAID)]
        said = said_in(ours[0]) if ours else {}
        stream = stream_from(said, "\n".join(lines))
        opened = cls(path=found, stream=stream, size=found.stat().st_size, packets_at=at)
        if not (stream.width and stream.height):
            width, height = opened._found_size()
            opened.stream = replace(stream, width=width, height=height)
        return opened

    def events(self) -> Iterator[Events]:
        """Events of each tick; special events, frames and IMU are counted in `left_out`."""
        damage, left_out = Damage(), dict[str, int]()
        order, stream = InOrder(damage, self.stream.tick_us), self.stream
        for at, overflow, raw in self._polarity(damage, left_out):
            data = raw["data"].astype(np.int64)
            x, y = data >> 17, data >> 2 & 0x7FFF
            valid = (data & 1).astype(np.bool_)
            _count(left_out, "invalid events", int(np.count_nonzero(~valid)))
            off = valid & ((x >= stream.width) | (y >= stream.height) | (raw["stamp"] < 0))
            if off.any():
                first = int(off.argmax())
                where = f"an event at ({x[first]}, {y[first]}), {raw['stamp'][first]} us,"
                wrong = f"{where} is outside the sensor or its time"
                damage.packet(at + 8 * first, wrong, int(np.count_nonzero(off)))
                damage.what = "events"
            kept = np.flatnonzero(valid & ~off)
            t = (overflow << 31) + raw["stamp"][kept].astype(np.int64)
            events = make_events(t, x[kept], y[kept], data[kept] >> 1 & 1)
            yield from order.feed(events, at + 8 * kept)
        yield from order.rest()
        self.damage, self.left_out = damage, left_out

    def _polarity(
        self, damage: Damage, left_out: dict[str, int]
    ) -> Iterator[tuple[int, int, npt.NDArray[np.void]]]:
        """(byte offset, overflows, events) of each part of a packet that holds polarity."""
        with self.path.open("rb") as file:
            at, broken = self.packets_at, -1
            while at < self.size:
                self.position = at
                head = _read_head(file, at)
                if head is None or not _fits(head, at, self.size):
                    broken = at if broken < 0 else broken
                    at = self._next_packet(file, at + 1)
                    continue
                if broken >= 0:
                    damage.packet(broken, "no packet begins here")
                    broken = -1
                begin = at + _NUMBERS.size
                at = begin + head.number * head.size
                if head.kind == _POLARITY:
                    yield from _parts(file, begin, head.number, head.overflow)
                else:
                    _count(left_out, _KINDS.get(head.kind, _KIND_OF_OTHERS), head.number)
            if broken >= 0:
                damage.tail(*self._whole_events(file, broken))
                yield from self._torn(file, broken)

    def _torn(self, file: BinaryIO, at: int) -> Iterator[tuple[int, int, npt.NDArray[np.void]]]:
        """The whole events of a polarity packet that the file ends in."""
        head = _read_head(file, at)
        end, _ = self._whole_events(file, at)
        if head is not None and end > at:
            begin = at + _NUMBERS.size
            yield from _parts(file, begin, (end - begin) // 8, head.overflow)

    def _whole_events(self, file: BinaryIO, at: int) -> tuple[int, int]:
        """(where what can be read ends, the file's size) if a packet at `at` is torn."""
        head = _read_head(file, at)
        begin = at + _NUMBERS.size
        if head is None or not _sound(head) or head.kind != _POLARITY:
            return at, self.size
        return begin + (self.size - begin) // 8 * 8, self.size

    def _next_packet(self, file: BinaryIO, start: int) -> int:
        """Offset at or after `start` at which a whole polarity packet begins; else the end."""
        at = start
        while at + _NUMBERS.size <= self.size:
            file.seek(at)
            chunk = file.read(_CHUNK_BYTES)
            found = chunk.find(_MARK, 4)
            while found >= 0 and found - 4 + _NUMBERS.size <= len(chunk):
                head = _Head(*_NUMBERS.unpack_from(chunk, found - 4))
                if _fits(head, at + found - 4, self.size):
                    return at + found - 4
                found = chunk.find(_MARK, found + 1)
            # a head that the chunk's end cuts is in the next one
            at += max(1, len(chunk) - _NUMBERS.size + 1)
        return self.size

    def _found_size(self) -> tuple[int, int]:
        """Width and height that the file's events need."""
        width = height = 1
        for _, _, raw in self._polarity(Damage(), {}):
            data = raw["data"][(raw["data"] & 1).astype(np.bool_)]
            width = max(width, 1 + int((data >> 17).max(initial=0)))
            height = max(height, 1 + int((data >> 2 & 0x7FFF).max(initial=0)))
        return width, height


def _read_head(file: BinaryIO, at: int) -> _Head | None:
    file.seek(at)
    data = file.read(_NUMBERS.size)
    return _Head(*_NUMBERS.unpack(data)) if len(data) == _NUMBERS.size else None


def _sound(head: _Head) -> bool:
    """Whether its numbers can be those of a packet."""
    counts = 0 <= head.valid <= head.number <= head.capacity
    if head.kind == _POLARITY:
        sizes = (head.size, head.stamp_at) == (8, 4)
    else:
        sizes = 0 < head.size <= 1 << 28
    return counts and sizes and 0 <= head.kind < 128 and head.overflow >= 0


def _fits(head: _Head, at: int, end: int) -> bool:
    """Whether it is sound, and its packet, at a byte offset, whole."""
    return _sound(head) and at + _NUMBERS.size + head.number * head.size <= end


def _parts(
    file: BinaryIO, at: int, number: int, overflow: int
) -> Iterator[tuple[int, int, npt.NDArray[np.void]]]:
    """The events of a packet, so many at a time."""
    end = at + 8 * number
    while at < end:
        file.seek(at)
        raw = np.frombuffer(file.read(min(8 * _CHUNK_EVENTS, end - at)), _EVENT)
        yield at, overflow, raw
        at += 8 * max(1, len(raw))


def _count(left_out: dict[str, int], what: str, count: int) -> None:
    if count:
        left_out[what] = left_out.get(what, 0) + count
