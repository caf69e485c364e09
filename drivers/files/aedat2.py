"""AEDAT2: jAER's files of a DAVIS (and, reading, a DVS128): header lines, then 8 bytes a word.

A word is big-endian: u32 address, i32 time stamp (us). Addresses count from the lower left, and x
from the right:

    DAVIS    bit 31 APS or IMU, 30-22 y, 21-12 x, 11 polarity, 10 external input
    DVS128   bit 15 sync, 14-8 y, 7-1 x, 0 polarity (0 is ON)

Stamps wrap at 2^31 us (35.8 min), and nothing tells how often. So the recorder splits: run.aedat,
run-001.aedat, ...; each says its `time_base_us`, so that each is read with its true times.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from evs.drivers.files.appending import AppendingRecorder
from evs.drivers.files.damage import Damage
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.header_text import said_in, stream_from, stream_json
from evs.drivers.files.numbered import check_no_parts, part_path
from evs.drivers.files.ordered import InOrder, Unwrap
from evs.drivers.files.recorded import EventsFile
from evs.drivers.files.recording import existing
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, make_events

MAGIC = b"#!AER-DAT2"
END = "#End Of ASCII Header"
SAID = "# evs "
MAX_WIDTH, MAX_HEIGHT = 1 << 10, 1 << 9
SPAN_US = 1 << 31

_WORD = np.dtype([("address", ">u4"), ("stamp", ">i4")])
_CHUNK_WORDS = 1 << 16
_MAX_HEADER_BYTES = 1 << 22
_AER_CHIPS = {(346, 260): "Davis346blue", (240, 180): "DAVIS240C"}

_APS, _IMU, _EXTERNAL = 0x80000000, 0xC00, 0x400

Bits = npt.NDArray[np.int64]


class Aedat2Recorder(AppendingRecorder):
    """A Sink that writes AEDAT2 as a DAVIS would, one file for each 2^31 us of the stream."""

    NAME = "aedat2"

    def __init__(self, path: AnyPath) -> None:
        super().__init__(path)
        self._base_us = 0
        self._parts = 1
        self._written = 0

    def write(self, packet: EventPacket) -> None:
        """Append one packet, over as many files as it needs. EvsError as AppendingRecorder's."""
        begin, stamps = 0, packet.events["t"]
        while begin < len(stamps):
            base_us = int(stamps[begin]) // SPAN_US * SPAN_US
            end = int(np.searchsorted(stamps, base_us + SPAN_US))
            if base_us != self._base_us and not self._failure and base_us >= 0:
                self._next(base_us)
            super().write(replace(packet, events=packet.events[begin:end]))
            begin = end

    def close(self) -> dict[str, Any]:
        """As AppendingRecorder's; `files` counts those that were written."""
        report = super().close()
        return report | {"bytes": self._written + self._position, "files": self._parts}

    def _next(self, base_us: int) -> None:
        """Go on in another file, or begin this one anew where nothing is in it yet."""
        if self._file is None:
            return
        if base_us < self._base_us:
            raise EvsError(
                f"cannot record to {self._path}: time steps back from {self._base_us} us to "
                f"{base_us} us or a little later, and AEDAT2 cannot say so; write .aedat4"
            )
        path = self._path if not self._events else part_path(self._path, self._parts)
        self._finish()
        if self._events:
            if self._parts == 1:
                check_no_parts(self._path)
            self._parts += 1
            self._written += self._position
        self._base_us = base_us
        self._start(path)

    def _header(self, stream: StreamInfo) -> bytes:
        chip = _AER_CHIPS.get((stream.width, stream.height))
        lines = [
            "#!AER-DAT2.0",
            "# This is a raw AE data file, by evs - do not edit",
            "# Data format is int32 address, int32 timestamp (8 bytes total), repeated",
            "# Timestamps tick is 1 us",
            *([f"# AEChip: eu.seebetter.ini.chips.davis.{chip}"] if chip else []),
            SAID + stream_json(stream, time_base_us=self._base_us, part=self._parts),
            END,
        ]
        return "".join(f"{line}\r\n" for line in lines).encode()

    def _encoded(self, events: Events) -> bytes:
        words = np.empty(len(events), _WORD)
        x = self.stream.width - 1 - events["x"].astype(np.uint32)
        y = self.stream.height - 1 - events["y"].astype(np.uint32)
        words["address"] = y << 22 | x << 12 | (events["p"] != 0).astype(np.uint32) << 11
        words["stamp"] = events["t"] - self._base_us
        return words.tobytes()


@dataclass
class Aedat2File(EventsFile):
    """One AEDAT2 file, ours or jAER's."""

    words_at: int = 0
    """where the words begin, bytes"""
    base_us: int = 0
    """what its stamps count from"""
    is_davis: bool = True
    """else it is a DVS128"""

    @classmethod
    def at(cls, path: AnyPath) -> Aedat2File:
        """Read the header. EvsError: no such file, not AEDAT2."""
        found = existing(path)
        try:
            with found.open("rb") as file:
                data = file.read(_MAX_HEADER_BYTES)
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        if not data.startswith(MAGIC):
            raise EvsError(
                f"{found} is not a readable AEDAT2 file: it does not begin with {MAGIC.decode()}; "
                "older files than version 2 are not read"
            )
        lines, words_at = _header_lines(data)
        if not lines:
            raise EvsError(f"{found} is not a readable AEDAT2 file: its first line is damaged")
        ours = [line.removeprefix(SAID) for line in lines if line.startswith(SAID)]
        said = said_in(ours[0]) if ours else {}
        text = "\n".join(line for line in lines if not line.startswith(SAID))
        base = said.get("time_base_us", 0)
        file_of = cls(
            path=found,
            stream=stream_from(said, text),
            size=found.stat().st_size,
            words_at=words_at,
            base_us=base if isinstance(base, int) and 0 <= base < 1 << 61 else 0,
            is_davis=bool(ours) or "DVS128" not in text.upper().replace("DAVIS128", ""),
        )
        if not (0 < file_of.stream.width <= MAX_WIDTH and 0 < file_of.stream.height <= MAX_HEIGHT):
            width, height = file_of._guessed_size()
            file_of.stream = replace(file_of.stream, width=width, height=height)
        return file_of

    def events(self) -> Iterator[Events]:
        """Events of each tick; words of APS, IMU and inputs are counted in `left_out`."""
        damage, left_out = Damage(what="words"), dict[str, int]()
        bad = _BadWords(self.words_at)
        order, unwrap = InOrder(damage, self.stream.tick_us), Unwrap(self.base_us)
        with self.path.open("rb") as file:
            for at, words in self._words(file):
                address = words["address"].astype(np.int64)
                is_event = self._are_events(address, left_out)
                x, y, p = self._fields(address)
                off = is_event & ((x < 0) | (y < 0))
                bad.meet(off, address, at, damage)
                # the clock of damaged words is not to be trusted, that of APS and IMU is
                t = np.zeros(len(words), np.int64)
                t[~off] = unwrap(words["stamp"][~off].astype(np.int64))
                kept = np.flatnonzero(is_event & ~off)
                events = make_events(t[kept], x[kept], y[kept], p[kept])
                yield from order.feed(events, at + 8 * kept)
        yield from order.rest()
        damage.tail(bad.sound_end, self.size)
        self.damage, self.left_out = damage, left_out

    def _words(self, file: BinaryIO) -> Iterator[tuple[int, npt.NDArray[np.void]]]:
        """(byte offset, words) of each chunk; a torn last word is not in it."""
        at = self.words_at
        file.seek(at)
        while len(chunk := file.read(8 * _CHUNK_WORDS)) >= 8:
            words = np.frombuffer(chunk, _WORD, len(chunk) // 8)
            self.position = at
            yield at, words
            at += len(chunk)

    def _are_events(
        self, address: Bits, left_out: dict[str, int] | None = None
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether each word is a pixel's event; the others are counted."""
        if not self.is_davis:
            kinds = {"sync words": (address & ~0x7FFF) != 0}
        else:
            high = (address & _APS) != 0
            imu = high & ((address & _IMU) == _IMU)
            kinds = {
                "APS words": high & ~imu,
                "IMU words": imu,
                "external input events": ~high & ((address & _EXTERNAL) != 0),
            }
        others = np.zeros(len(address), np.bool_)
        for name, which in kinds.items():
            others |= which
            count = int(np.count_nonzero(which))
            if left_out is not None and count:
                left_out[name] = left_out.get(name, 0) + count
        return ~others

    def _fields(self, address: Bits) -> tuple[Bits, Bits, Bits]:
        """x, y (negative: outside the sensor), p of each address."""
        if self.is_davis:
            x, y, p = address >> 12 & 0x3FF, address >> 22 & 0x1FF, address >> 11 & 1
        else:
            x, y, p = address >> 1 & 0x7F, address >> 8 & 0x7F, 1 - (address & 1)
        return self.stream.width - 1 - x, self.stream.height - 1 - y, p

    def _guessed_size(self) -> tuple[int, int]:
        """Width and height of the smallest DAVIS that has all addresses of the file."""
        x_most = y_most = 0
        with self.path.open("rb") as file:
            for _, words in self._words(file):
                address = words["address"].astype(np.int64)
                address = address[self._are_events(address)]
                x_most = max(x_most, int((address >> 12 & 0x3FF).max(initial=0)))
                y_most = max(y_most, int((address >> 22 & 0x1FF).max(initial=0)))
        for width, height in ((240, 180), (346, 260), (640, 480)):
            if x_most < width and y_most < height:
                return width, height
        return MAX_WIDTH, MAX_HEIGHT


class _BadWords:
    """Words that no pixel has; behind the last sound word they are part of a torn tail."""

    def __init__(self, begin: int) -> None:
        self.sound_end = begin
        """where the last sound word ends, bytes"""
        self._waiting: list[tuple[int, str, int]] = []

    def meet(self, off: npt.NDArray[np.bool_], address: Bits, at: int, damage: Damage) -> None:
        """Look at the next words, (n,). In: which are bad, their addresses, their byte offset."""
        sound = np.flatnonzero(~off)
        whole = int(sound[-1]) + 1 if len(sound) else 0
        if whole:
            # a sound word follows all that waited
            for found in self._waiting:
                damage.packet(*found)
            self._waiting = []
            self.sound_end = at + 8 * whole
        for begin, end in ((0, whole), (whole, len(off))):
            bad = np.flatnonzero(off[begin:end]) + begin
            if len(bad):
                reason = f"address {int(address[bad[0]]):#010x} lies outside the sensor"
                found = at + 8 * int(bad[0]), reason, len(bad)
                if end == whole:
                    damage.packet(*found)
                else:
                    self._waiting.append(found)


def _header_lines(data: bytes) -> tuple[list[str], int]:
    """The header's lines, and where the words begin."""
    lines, at = [], 0
    while data[at : at + 1] == b"#":
        end = data.find(b"\n", at)
        text = data[at:end].rstrip(b"\r") if end >= 0 else b"\0"
        # the first word may begin with the byte of a '#' too; a line of text has no such bytes
        if any(byte < 32 and byte != 9 for byte in text):
            break
        lines.append(text.decode(errors="replace"))
        at = end + 1
        if lines[-1].strip() == END:
            break
    return lines, at
