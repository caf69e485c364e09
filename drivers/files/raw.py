"""RAW files of Prophesee's cameras, words of EVT2, EVT2.1 or EVT3: recorders and reader.

They begin with lines of text, `% key value`, of which the last is `% end`.
"""

from __future__ import annotations

import dataclasses
import os
import re
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from evs.drivers.files.appending_recorder import AppendingRecorder
from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.header_text import (
    json_object,
    percent_lines,
    stream_from_json,
    stream_json,
)
from evs.drivers.files.integrity import MAX_STAMP_US, IntegrityReport, on_sensor
from evs.drivers.files.paths import existing
from evs.drivers.files.recording_file import MultiStreamFile, by_tick
from evs.drivers.files.time_order import EventSorter, Interleaver, Message
from evs.msgs import Events, EvsError, StreamInfo, Triggers
from evs.msgs.codecs import (
    decode_evt2,
    decode_evt3,
    decode_evt21,
    encode_evt2,
    encode_evt3,
    encode_evt21,
)

MAX_HEADER_BYTES = 1 << 24
"""A longer header is corrupt; ours contains the configuration of the run."""

STREAM = "evs_stream"
ORIGIN = "evs_time_origin_us"

_SIDES = re.compile(r"(\d{1,5})x(\d{1,5})")
_GENERATIONS = {"2": (304, 240), "3": (640, 480), "4": (1280, 720)}
"""generation of Prophesee's sensors -> width, height, px, for files that state no size"""


_GEN3, _GEN31, _GEN4, _GEN41, _IMX636 = (
    ("Gen3.0", 640, 480),
    ("Gen3.1", 640, 480),
    ("Gen4.0", 1280, 720),
    ("Gen4.1", 1280, 720),
    ("IMX636", 1280, 720),
)
_EVT2, _EVT3 = "2.0", "3.0"
SYSTEMS: dict[int, tuple[str, tuple[str, int, int]]] = {
    **dict.fromkeys((0x15, 0x17, 0x19, 0x1D, 0x21, 0x97, 0x99, 0xA1), (_EVT2, _GEN3)),
    **dict.fromkeys((0x1C, 0x22, 0x23, 0x29, 0xA2), (_EVT2, _GEN31)),
    **dict.fromkeys((0x1A, 0x1F), (_EVT2, _GEN4)),
    0x27: (_EVT2, _GEN41),
    0x28: (_EVT3, _GEN31),
    **dict.fromkeys((0x1E, 0x2E), (_EVT3, _GEN4)),
    0x30: (_EVT3, _GEN41),
    **dict.fromkeys((0x31, 0x32), (_EVT3, _IMX636)),
}
"""system_ID of Prophesee's cameras -> EVT version, and sensor with its width and height, px, for
files of old software that state neither; as OpenEB 5.1 has it"""

_OTHER_FORMATS = {
    "EVT4": "which OpenEB's metavision_file_to_hdf5 converts",
    "AER-8b": "addresses of a GenX320 without time stamps",
    "AER-4b": "addresses of a GenX320 without time stamps",
    "HISTO3D": "histograms of events",
    "DIFF3D": "differences of events",
    "MTR": "frames",
}
"""formats in headers that are not read -> what they hold"""


@dataclass(frozen=True)
class RawHeader:
    """The content of the header."""

    version: str
    """EVT version of the events: `2.0`, `2.1` or `3.0`; empty: not stated"""
    stream: StreamInfo
    """width and height are 0 where they are not stated"""
    time_origin_us: int
    """stamp of the stream's time zero"""
    size: int
    """its bytes"""
    upper_first: bool | None = None
    """EVT2.1: whether the upper half of each word comes first (IMX636); None: not stated"""
    ours: bool = False
    """whether evs recorded it, which means that it holds only events"""
    form: str = ""
    """name of its format where it is none of EVT2, EVT2.1 and EVT3; empty: not stated"""
    read_as: str = ""
    """what follows from its system_ID; empty: nothing"""


def header_bytes(stream: StreamInfo, version: str, time_origin_us: int) -> bytes:
    """The header of our files: the lines that Prophesee's SDK needs, then two of our own."""
    name = {"2.1": "EVT21;endianness=little"}.get(version, f"EVT{version[0]}")
    lines = {
        "evt": version,
        "format": f"{name};height={stream.height};width={stream.width}",
        # Prophesee's SDK states the order of the halves in a line of its own as well
        **({"endianness": "little"} if version == "2.1" else {}),
        "geometry": f"{stream.width}x{stream.height}",
        "camera_integrator_name": "evs",
        "plugin_integrator_name": "Prophesee",
        "plugin_name": "hal_plugin_prophesee",
        ORIGIN: str(time_origin_us),
        STREAM: stream_json(stream),
    }
    return "".join(f"% {key} {value}\n" for key, value in lines.items()).encode() + b"% end\n"


def parse_header(head: bytes) -> RawHeader:
    """Parse the first bytes of a file; never raises."""
    lines, size = percent_lines(head, last="end")
    version = lines.get("evt", "")
    parts = dict(part.partition("=")[::2] for part in lines.get("format", "").split(";"))
    for name, number in (("EVT21", "2.1"), ("EVT2", "2.0"), ("EVT3", "3.0")):
        version = number if name in parts else version
    form = next(iter(parts), "").strip()
    version, sides, read_as = _by_system(lines, form, version, _size(lines, parts))
    default = StreamInfo(*sides, sensor="unknown")
    origin = lines.get(ORIGIN, "0")
    # of a stream that begins at a Unix time it is negative
    digits = origin.removeprefix("-")
    known = digits.isascii() and digits.isdigit() and len(digits) < 17
    stream = stream_from_json(json_object(lines.get(STREAM, "")), default)
    # frames and IMU samples went elsewhere
    stream = dataclasses.replace(stream, frames=False, imu=False, triggers=False)
    order = parts.get("endianness")
    upper_first = None if order is None else order == "legacy"
    return RawHeader(
        version,
        stream,
        int(origin) if known else 0,
        size,
        upper_first,
        STREAM in lines,
        "" if form.startswith(("EVT2", "EVT3")) else form,
        read_as,
    )


def _by_system(
    lines: dict[str, str], form: str, version: str, sides: tuple[int, int]
) -> tuple[str, tuple[int, int], str]:
    """Version and size, from the camera's system_ID where the header lacks them; what it says."""
    text = lines.get("system_id", "")
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else -1
    makers = {
        lines.get(key, "Prophesee")
        for key in ("integrator_name", "plugin_integrator_name", "camera_integrator_name")
    }
    if number not in SYSTEMS or makers != {"Prophesee"}:
        return version, sides, ""
    evt, (sensor, width, height) = SYSTEMS[number]
    found = [] if version or form else [f"EVT {evt}"]
    if not all(sides):
        found.append(f"{width} x {height} px")
        sides = width, height
    reason = f"{', '.join(found)} ({sensor}), by its system_ID {number}" if found else ""
    return version if version or form else evt, sides, reason


def _size(lines: dict[str, str], parts: dict[str, str]) -> tuple[int, int]:
    """Width and height, px; 0, 0 if they are not stated."""
    geometry = _SIDES.fullmatch(lines.get("geometry", ""))
    for width, height in (
        (parts.get("width", ""), parts.get("height", "")),
        geometry.groups() if geometry else ("", ""),
        (lines.get("width", ""), lines.get("height", "")),
    ):
        if all(side.isascii() and side.isdigit() and len(side) < 6 for side in (width, height)):
            sides = int(width), int(height)
            if all(0 < side <= MAX_SIDE_PX for side in sides):
                return sides
    generation = lines.get("sensor_generation", lines.get("generation", ""))
    return _GENERATIONS.get(generation[:1], (0, 0))


class _RawRecorder(AppendingRecorder):
    """The base of the recorders. The clock of a file is at 0 when the stream begins.

    The first word states time zero, so every reader, whether or not it shifts time stamps to the
    first word, returns those of the stream. Where the stream begins later (`scene.start_us`), the
    header states the origin, which our reader subtracts. Every packet restates the time, so a file
    that was cut anywhere is read up to there.
    """

    _VERSION: str

    def _header(self, stream: StreamInfo) -> bytes:
        self._origin_us = -stream.start_us
        self._after_us = stream.start_us
        return header_bytes(stream, self._VERSION, self._origin_us)

    def _encode(self, events: Events) -> bytes:
        if int(events["t"][0]) < self._after_us:
            raise EvsError(
                f"{self._path}: events at {events['t'][0]} us come after {self._after_us} us, and "
                f"{self._format_name} has no way back in time; record to .aedat4"
            )
        data = self._words(events)
        self._after_us = int(events["t"][-1])
        return data

    @abstractmethod
    def _words(self, events: Events) -> bytes:
        """The words of one packet's events, (n,) with n > 0."""


class Evt3Recorder(_RawRecorder):
    """EVT3: 2 to 8 bytes an event."""

    NAME, _VERSION = "evt3", "3.0"

    def _words(self, events: Events) -> bytes:
        return encode_evt3(events, time_origin_us=self._origin_us, after_us=self._after_us)


class Evt2Recorder(_RawRecorder):
    """EVT2: 4 bytes an event, and 4 for each new 64 us."""

    NAME, _VERSION = "evt2", "2.0"

    def _words(self, events: Events) -> bytes:
        return encode_evt2(events, time_origin_us=self._origin_us, after_us=self._after_us)


class Evt21Recorder(_RawRecorder):
    """EVT2.1: 8 bytes for up to 32 events of one instant and row, and 8 for each new 64 us."""

    NAME, _VERSION = "evt21", "2.1"

    def _words(self, events: Events) -> bytes:
        return encode_evt21(events, time_origin_us=self._origin_us, after_us=self._after_us)


_PIECE_BYTES = 1 << 18
_NO_TIME_YET = "events before the first time stamp, or too far right for the format,"
_TRIGGER = 10
"""type of the words of external triggers, in each version"""
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
        if header.form or header.version not in _DECODERS:
            raise EvsError(f"{found} {_refused(header)}; EVT 2.0, 2.1 and 3.0 are read")
        opened = cls(
            found,
            header.stream,
            size,
            version=header.version,
            time_origin_us=header.time_origin_us,
            begin=header.size,
            read_as=header.read_as,
        )
        if header.version == "2.1":
            order = header.upper_first
            opened.upper_first = opened._is_swapped() if order is None else order
        if not opened.stream.width:
            opened._find_size()
        if not header.ours:
            opened.stream = dataclasses.replace(opened.stream, triggers=opened._has_triggers())
        return opened

    @property
    def format_name(self) -> str:
        """Its format in the table: endings do not decide."""
        return {"2.0": "evt2", "2.1": "evt21"}.get(self.version, "evt3")

    def _iterate(self, events: bool, auxiliary: bool) -> Iterator[Message]:
        """The events of each tick (1 ms where the file states none) that has any, and triggers."""
        integrity = IntegrityReport(noun="events")
        sorter, interleaver = EventSorter(integrity, self.stream), Interleaver()
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
        """Read the file piece by piece.

        Args:
            integrity: Receives the events outside the sensor and the torn tail.
            triggers: A list that takes the triggers of each piece; None: they are not read.

        Yields:
            The byte offset of each piece, and its events in the order recorded.
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


def _refused(header: RawHeader) -> str:
    """What a file holds that is not read, in words."""
    form = "EVT4" if header.version == "4.0" else header.form
    for name, holds in _OTHER_FORMATS.items():
        if form == name:
            return f"is {name} in its header, {holds}"
    if form or header.version:
        return f"is {(form or f'EVT {header.version}')[:20]!r} in its header"
    return "does not name its EVT in its header, nor a system_ID that tells it"


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
