"""Aedat2File: AEDAT2 and AEDAT1 files as events, and a DAVIS's frames and IMU samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from evs.drivers.files.aedat2.davis import FrameAssembler, ImuAssembler
from evs.drivers.files.aedat2.evidence import found_chip
from evs.drivers.files.aedat2.layout import (
    CHIP,
    EVS_LINE,
    MAGIC,
    MAGIC_1,
    MAX_HEIGHT,
    MAX_WIDTH,
    WORD,
    WORD_1,
    header_lines,
)
from evs.drivers.files.chips import APS, CHIP_NAMES, CHIPS, IMU, Bits, Chip, chip_named
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
    """An AEDAT2 file, of evs, jAER or v2e, or an AEDAT1 file of a DVS128."""

    words_at: int = 0
    """where the words begin, bytes"""
    base_us: int = 0
    """time of its time stamp 0, us"""
    chip: Chip = CHIPS[0]
    """whose layout its addresses have"""
    word: np.dtype[np.void] = WORD
    """of an event"""
    part: int | None = None
    """number of this file in a recording of several, from 0; None: not stated"""

    @classmethod
    def at(cls, path: AnyPath, chip: str = "") -> Aedat2File:
        """Open a file and read its header.

        Args:
            path: The file.
            chip: The chip's name, in place of what the header states or the addresses tell.

        Raises:
            EvsError: There is no such file, it is of another version, or it cannot be known of
                which chip it is.
        """
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
        stated, chip_line = own_line_and_chip(lines, EVS_LINE, CHIP)
        base, part = (stated or {}).get("time_base_us", 0), (stated or {}).get("part")
        opened = cls(
            path=found,
            stream=stream_from_header(stated, ""),
            size=found.stat().st_size,
            words_at=words_at,
            base_us=base if isinstance(base, int) and 0 <= base < 1 << 61 else 0,
            part=part - 1 if isinstance(part, int) and part > 0 else None,
            word=WORD_1 if is_first else WORD,
        )
        stream = opened.stream
        if not (0 < stream.width <= MAX_WIDTH and 0 < stream.height <= MAX_HEIGHT):
            stated = None
        if stated is None:
            opened._find_chip(chip, chip_line, lines)
        elif chip:
            raise EvsError(f"{found} states its layout, since evs recorded it: leave --chip out")
        return opened

    def _find_chip(self, given: str, line: str, lines: list[str]) -> None:
        """Find the chip of another program's file, and whether it has frames and IMU samples."""
        first = self.word is WORD_1
        known = chip_named(given) if given else chip_named(line)
        if known is None and (given or line):
            name = given or line.rpartition(".")[2]
            raise EvsError(
                f"{self.path}: the addresses of the chip '{name[:40]}' are not known"
                f"{'' if given else '; give one of the same layout with --chip'}; there are "
                f"{', '.join(CHIP_NAMES)}"
            )
        if known is None and first:
            known = chip_named("dvs128")
        if known is None:
            with self.path.open("rb") as file:
                words = (words["address"].astype(np.int64) for _, words in self._words(file))
                known, self.read_as = found_chip(self.path, lines, words)
                self.guessed = True
        elif given:
            self.read_as = f"{known.name}, as stated by the reader"
        assert known is not None
        self.chip = known
        self.stream = replace(
            self.stream, width=known.width, height=known.height, sensor=known.name
        )
        if known.is_davis and not first:
            self._find_auxiliary()

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
                kinds = self.chip.kinds(address)
                is_event = np.ones(len(words), np.bool_)
                for which in kinds.values():
                    is_event &= ~which
                x, y, p = self.chip.fields(address, self.stream.width, self.stream.height)
                off = is_event & (x < 0)
                bad.check(off, address, at, integrity)
                # the clock of damaged words is not to be trusted, that of APS and IMU is
                t = np.zeros(len(words), np.int64)
                t[~off] = unwrap(words["stamp"][~off].astype(np.int64))
                if auxiliary and self.chip.is_davis:
                    which = kinds[IMU]
                    for part in by_tick(imu.feed(address[which], t[which]), self.stream):
                        yield from interleaver.add(int(part["t"][-1]), part)
                    which = kinds[APS]
                    for frame in aps.feed(address[which], t[which]):
                        yield from interleaver.add(frame.end_us, frame)
                for name, which in kinds.items():
                    if not (auxiliary and self.chip.is_davis and name in (APS, IMU)):
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

    def _find_auxiliary(self) -> None:
        """Find out whether a DAVIS's file has frames and IMU samples."""
        frames = imu = False
        with self.path.open("rb") as file:
            for _, words in self._words(file):
                kinds = self.chip.kinds(words["address"].astype(np.int64))
                frames |= bool(kinds[APS].any())
                imu |= bool(kinds[IMU].any())
                if frames and imu:
                    break
        self.stream = replace(self.stream, frames=frames, imu=imu)


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
