"""Aedat2File: any AEDAT2 or AEDAT1 file as events, and a DAVIS's frames and IMU samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from evs.drivers.files.aedat2.davis import FrameAssembler, ImuAssembler
from evs.drivers.files.aedat2.layout import (
    APS,
    CHIP,
    EVS_LINE,
    EXTERNAL,
    IMU,
    MAGIC,
    MAGIC_1,
    MAX_HEIGHT,
    MAX_WIDTH,
    WORD,
    WORD_1,
    Bits,
    header_lines,
    place,
)
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.header_text import own_line_and_chip, read_file_head, stream_from_header
from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.recording_file import MultiStreamFile, by_tick
from evs.drivers.files.time_order import EventSorter, Interleaver, TimestampUnwrapper
from evs.msgs import Events, EvsError, Frame, ImuSamples, make_events

_CHUNK_WORDS = 1 << 16

Mask = npt.NDArray[np.bool_]


@dataclass
class Aedat2File(MultiStreamFile):
    """An AEDAT2 file, of evs or jAER, or an AEDAT1 file of a DVS128."""

    words_at: int = 0
    """where the words begin, bytes"""
    base_us: int = 0
    """time of its time stamp 0, us"""
    is_davis: bool = True
    """whether it is a DAVIS; if not, a DVS128"""
    word: np.dtype[np.void] = WORD
    """of an event"""
    part: int | None = None
    """number of this file in a recording of several, from 0; None: not stated"""

    @classmethod
    def at(cls, path: AnyPath) -> Aedat2File:
        """Open a file and read its header. EvsError: no such file, of another version."""
        found, data = read_file_head(path)
        if not data.startswith((MAGIC, MAGIC_1)):
            raise EvsError(
                f"{found} is not a readable AEDAT2 file: it does not begin with {MAGIC.decode()}; "
                f"to read a file of version 1 without a header, put the line {MAGIC_1.decode()}.0 "
                "before it"
            )
        is_first = data.startswith(MAGIC_1)
        lines, words_at = header_lines(data)
        if not lines:
            raise EvsError(f"{found} is not a readable AEDAT file: its first line is damaged")
        stated, chip = own_line_and_chip(lines, EVS_LINE, CHIP)
        base, part = (stated or {}).get("time_base_us", 0), (stated or {}).get("part")
        opened = cls(
            path=found,
            stream=stream_from_header(stated, chip),
            size=found.stat().st_size,
            words_at=words_at,
            base_us=base if isinstance(base, int) and 0 <= base < 1 << 61 else 0,
            part=part - 1 if isinstance(part, int) and part > 0 else None,
            is_davis=not is_first and (stated is not None or "DVS128" not in chip.upper()),
            word=WORD_1 if is_first else WORD,
        )
        if is_first and not opened.stream.width:
            opened.stream = replace(opened.stream, width=128, height=128, sensor="dvs128")
        stream = opened.stream
        fits = 0 < stream.width <= MAX_WIDTH and 0 < stream.height <= MAX_HEIGHT
        if not fits or (opened.is_davis and stated is None):
            opened._probe(sized=fits)
        return opened

    def _iterate(self, events: bool, auxiliary: bool) -> Iterator[Events | Frame | ImuSamples]:
        """The requested messages; external inputs and torn frames are counted in `left_out`."""
        integrity, left_out = IntegrityReport(noun="words"), dict[str, int]()
        bad = _BadWordTracker(self.words_at, self.word.itemsize)
        interleaver = Interleaver()
        sorter, unwrap = EventSorter(integrity, self.stream), TimestampUnwrapper(self.base_us)
        aps = FrameAssembler(self.stream.width, self.stream.height, self.stream.camera)
        imu = ImuAssembler()
        with self.path.open("rb") as file:
            for at, words in self._words(file):
                address = words["address"].astype(np.int64)
                kinds = self._kinds(address)
                is_event = ~np.logical_or.reduce(list(kinds.values()))
                x, y, p = self._fields(address)
                off = is_event & ((x < 0) | (y < 0))
                bad.check(off, address, at, integrity)
                # the clock of damaged words is not to be trusted, that of APS and IMU is
                t = np.zeros(len(words), np.int64)
                t[~off] = unwrap(words["stamp"][~off].astype(np.int64))
                if auxiliary:
                    which = kinds["IMU words"]
                    for part in by_tick(imu.feed(address[which], t[which]), self.stream):
                        yield from interleaver.add(int(part["t"][-1]), part)
                    which = kinds["APS words"]
                    for frame in aps.feed(address[which], t[which]):
                        yield from interleaver.add(frame.end_us, frame)
                for name, which in kinds.items():
                    if not (auxiliary and name in ("APS words", "IMU words")):
                        _count(left_out, name, int(np.count_nonzero(which)))
                if events:
                    kept = np.flatnonzero(is_event & ~off)
                    found = make_events(t[kept], x[kept], y[kept], p[kept])
                    for part in sorter.feed(found, at + self.word.itemsize * kept):
                        yield from interleaver.merge(part)
        for part in sorter.flush():
            yield from interleaver.merge(part)
        imu.flush()
        for frame in aps.flush():
            yield from interleaver.add(frame.end_us, frame)
        yield from interleaver.flush()
        _count(left_out, "frames that are not whole", aps.torn)
        _count(left_out, "APS words of no frame", aps.lost)
        _count(left_out, "IMU words of no whole sample", imu.lost)
        integrity.torn_tail(bad.sound_end, self.size)
        self.integrity, self.left_out = integrity, left_out

    def _words(self, file: BinaryIO) -> Iterator[tuple[int, npt.NDArray[np.void]]]:
        """(byte offset, words) of each chunk, without a torn last word."""
        at, size = self.words_at, self.word.itemsize
        file.seek(at)
        while len(chunk := file.read(size * _CHUNK_WORDS)) >= size:
            words = np.frombuffer(chunk, self.word, len(chunk) // size)
            self.position = at
            yield at, words
            at += len(chunk)

    def _kinds(self, address: Bits) -> dict[str, Mask]:
        """Kind of words other than events -> (n,) which words are of it."""
        if not self.is_davis:
            none = np.zeros(len(address), np.bool_)
            return {
                "sync words": (address & ~0x7FFF) != 0,
                "APS words": none,
                "IMU words": none,
            }
        high = (address & APS) != 0
        imu = high & ((address & IMU) == IMU)
        return {
            "APS words": high & ~imu,
            "IMU words": imu,
            "external input events": ~high & ((address & EXTERNAL) != 0),
        }

    def _fields(self, address: Bits) -> tuple[Bits, Bits, Bits]:
        """x, y (negative: outside the sensor), p of each address."""
        if self.is_davis:
            (x, y), p = place(address), address >> 11 & 1
        else:
            x, y, p = address >> 1 & 0x7F, address >> 8 & 0x7F, 1 - (address & 1)
        return self.stream.width - 1 - x, self.stream.height - 1 - y, p

    def _probe(self, sized: bool) -> None:
        """Find out whether there are frames and IMU samples, and the sensor's size.

        Args:
            sized: Whether the size is known; if not, the smallest DAVIS that has all addresses.
        """
        x_most = y_most = 0
        has = {"frames": False, "imu": False}
        with self.path.open("rb") as file:
            for _, words in self._words(file):
                address = words["address"].astype(np.int64)
                kinds = self._kinds(address)
                has["frames"] |= bool(kinds["APS words"].any())
                has["imu"] |= bool(kinds["IMU words"].any())
                if sized and all(has.values()):
                    break
                if not sized:
                    others = [which for name, which in kinds.items() if name != "APS words"]
                    x, y = place(address[~np.logical_or.reduce(others)])
                    x_most = max(x_most, int(x.max(initial=0)))
                    y_most = max(y_most, int(y.max(initial=0)))
        sides = MAX_WIDTH, MAX_HEIGHT
        for width, height in ((640, 480), (346, 260), (240, 180)):
            if x_most < width and y_most < height:
                sides = width, height
        if not sized:
            self.stream = replace(self.stream, width=sides[0], height=sides[1])
        self.stream = replace(self.stream, frames=has["frames"], imu=has["imu"])


class _BadWordTracker:
    """Tracks words outside the sensor; after the last valid word they are part of a torn tail."""

    def __init__(self, begin: int, word_bytes: int) -> None:
        self._word_bytes = word_bytes
        self.sound_end = begin
        """byte offset of the end of the last valid word"""
        self._waiting: list[tuple[int, str, int]] = []

    def check(self, off: Mask, address: Bits, at: int, integrity: IntegrityReport) -> None:
        """Check the next words, (n,): which are bad, their addresses, their byte offset."""
        sound = np.flatnonzero(~off)
        whole = int(sound[-1]) + 1 if len(sound) else 0
        if whole:
            # a sound word follows all that waited
            for found in self._waiting:
                integrity.corrupt(*found)
            self._waiting = []
            self.sound_end = at + self._word_bytes * whole
        for begin, end in ((0, whole), (whole, len(off))):
            bad = np.flatnonzero(off[begin:end]) + begin
            if len(bad):
                reason = f"address {int(address[bad[0]]):#010x} lies outside the sensor"
                found = at + self._word_bytes * int(bad[0]), reason, len(bad)
                if end == whole:
                    integrity.corrupt(*found)
                else:
                    self._waiting.append(found)


def _count(left_out: dict[str, int], what: str, count: int) -> None:
    if count:
        left_out[what] = left_out.get(what, 0) + count
