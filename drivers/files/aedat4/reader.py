"""Aedat4File: reads AEDAT4 files, whole or damaged."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from evs.drivers.files.aedat4 import compression as compressions
from evs.drivers.files.aedat4 import description, layout
from evs.drivers.files.aedat4.auxiliary import (
    OtherFormatError,
    parse_frame,
    parse_imu,
    parse_triggers,
)
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.integrity import IntegrityReport, bad_values, normalised
from evs.drivers.files.paths import existing
from evs.drivers.files.recording_file import choose_stream, of_stream
from evs.drivers.files.time_order import CLOCK_RESET_US, PacketSorter
from evs.msgs import EVENT_DTYPE, Events, EvsError, Frame, ImuSamples, StreamInfo, Triggers

MAX_HEADER_BYTES = 1 << 26
MAX_TRIES = 1000
"""After corrupt data, the number of places that look like a packet that are tried."""

COLOURED = "frames that are not grey"

_UNREAD = {"EVTS": "events", "FRME": "frames", "IMUS": "IMU samples", "TRIG": "triggers"}
"""kind of a stream that is not read -> what is counted of it"""

_TABLE_HEAD_BYTES = 1 << 23
_CHUNK_BYTES = 1 << 20
_MIN_BODY_BYTES = 12
_PLAIN_KINDS = re.compile(b"EVTS|FRME|IMUS|TRIG")

Message = Events | Frame | ImuSamples | Triggers

_Parser = Callable[[bytes], Message | str | None]
"""Parses the body of a packet: a message, None, or the reason why it is damaged."""


@dataclass
class Aedat4File:
    """One AEDAT4 file, ours or another writer's, opened with `Aedat4File.at(path)`.

    Events come from the chosen event stream, or the first that the file declares (or holds, if it
    declares none). Frames, IMU samples and triggers come from the first of theirs, of the same
    camera if there are several event streams. What other streams hold is counted in `left_out`. A
    file may declare no events: it is read as what it has, of the size of its frames. Bytes that do
    not check out are left out and reported: as damaged packets where a whole packet follows
    somewhere, else as a torn tail.
    """

    path: Path
    stream: StreamInfo
    compression: str
    declared: dict[int, description.Declared]
    header: layout.IOHeader
    event_id: int
    packets_at: int
    """where the first packet begins, bytes"""
    packets_end: int
    """where packets end at the latest, bytes"""
    table_packets: int | None
    """packets in the data table at the end; None: there is no whole one"""
    end: int
    """where the file ends, with its table and without what follows it, bytes"""
    size: int
    integrity: IntegrityReport = field(default_factory=IntegrityReport)
    """what the last complete walk over the packets found"""
    whole_packets: int = 0
    """packets of any stream that the last complete walk found whole"""
    left_out: dict[str, int] = field(default_factory=dict)
    """frames that the last walk left out, since they are not grey, and what other streams hold"""
    streams: dict[str, str] = field(default_factory=dict)
    position: int = 0
    """how far the present walk is, bytes"""
    labels: None = None
    """the format has no place for any"""

    @classmethod
    def at(cls, path: str | os.PathLike[str], stream: str | int | None = None) -> Aedat4File:
        """Read the header.

        Args:
            path: The file.
            stream: Id or name of the event stream; None: the first.

        Raises:
            EvsError: No such file, not AEDAT4, nothing in it that we read, or no such stream.
        """
        found = existing(path)
        try:
            with found.open("rb") as file:
                return cls._opened(found, file, stream)
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        except CorruptDataError as reason:
            raise EvsError(f"{found} is not a readable AEDAT4 file: {reason}") from None

    def events(self) -> Iterator[Events]:
        """The events of each packet, read-only and never empty; the end sets `integrity`."""
        with self.path.open("rb") as file:
            parsers = {self.event_id: self._parse_events}
            for events in self._in_order(file, parsers, ("EVTS",)):
                assert isinstance(events, np.ndarray)
                yield events

    def messages(self) -> Iterator[Message]:
        """What is in each packet of our four streams, in the file's order; sets `integrity`."""
        with self.path.open("rb") as file:
            yield from self._in_order(file, self._parsers(), tuple(_UNREAD))

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers alone, in the file's order; sets `integrity`."""
        with self.path.open("rb") as file:
            others = ("FRME", "IMUS", "TRIG")
            for number, message in self._iterate_packets(file, self._parsers(), counted=others):
                if number != self.event_id:
                    assert not isinstance(message, np.ndarray) or message.dtype != EVENT_DTYPE
                    yield message

    def _in_order(
        self, file: BinaryIO, parsers: Mapping[int, _Parser], counted: Collection[str]
    ) -> Iterator[Message]:
        """The messages of the packets; events that are late lie in the packets of their time.

        Only another writer's events move between packets: our recorder keeps them in order, or
        records a clock that steps back on purpose.
        """
        integrity = IntegrityReport()
        sorter = PacketSorter(integrity)
        for number, message in self._iterate_packets(file, parsers, counted=counted):
            if number != self.event_id:
                assert not isinstance(message, np.ndarray) or message.dtype != EVENT_DTYPE
                yield from sorter.add(message)
            else:
                assert isinstance(message, np.ndarray)
                yield from sorter.feed(message, self.position)
                if self._is_ours:
                    yield from sorter.flush()
        yield from sorter.flush()
        if integrity.backwards_at is not None:
            self.integrity.backwards(integrity.unsorted, integrity.resets, integrity.backwards_at)
            self.integrity.unplaced += integrity.unplaced

    @property
    def _is_ours(self) -> bool:
        """Whether evs recorded it."""
        info = self.declared[self.event_id].info if self.event_id in self.declared else {}
        return "tick_us" in info

    @property
    def part(self) -> int | None:
        """Number of this file in a recording of several, from 0; None: not stated."""
        info = self.declared[self.event_id].info if self.event_id in self.declared else {}
        text = info.get("part", "")
        return int(text) if text.isascii() and text.isdigit() and len(text) < 10 else None

    @property
    def broken_pointer(self) -> bool:
        """Whether the header points to a missing data table: dv-processing refuses such a file."""
        return self.header.table_position > 0 and self.table_packets is None

    def first_packet_fits(self) -> bool:
        """Whether there is a first packet that, by its stated length, is not torn."""
        with self.path.open("rb") as file:
            try:
                self._packet(file, self.packets_at)
            except CorruptDataError:
                return False
        return True

    @classmethod
    def _opened(cls, path: Path, file: BinaryIO, wanted: str | int | None) -> Aedat4File:
        size = os.fstat(file.fileno()).st_size
        if file.read(len(layout.MAGIC)) != layout.MAGIC:
            raise CorruptDataError("it does not begin with the AEDAT4 line")
        prefix = file.read(4)
        length = int.from_bytes(prefix, "little")
        packets_at = len(layout.MAGIC) + 4 + length
        if len(prefix) < 4 or packets_at > size or length > MAX_HEADER_BYTES:
            raise CorruptDataError("its header is torn")
        header = layout.parse_io_header(prefix + file.read(length))
        if header.compression not in compressions.NAMES:
            raise CorruptDataError(f"compression {header.compression} does not exist")
        compression = compressions.NAMES[header.compression]
        streams = description.from_xml(header.xml)
        end, table_packets = size, None
        if packets_at <= header.table_position < size:
            end, table_packets = _table(file, header.table_position, size, compression)
        whole = table_packets is not None
        event_streams = choose_stream(path, description.event_streams(streams), wanted)
        opened = cls(
            path=path,
            stream=StreamInfo(0, 0),
            compression=compression,
            declared=streams,
            header=header,
            event_id=int(next(iter(event_streams), -1)),
            streams=event_streams,
            packets_at=packets_at,
            packets_end=header.table_position if whole else size,
            table_packets=table_packets,
            end=end,
            size=size,
        )
        opened._find_stream(file)
        return opened

    def _find_stream(self, file: BinaryIO) -> None:
        """Find the stream in the description, or else in the packets."""
        frames, imu, triggers = (self._first_stream(one) for one in ("FRME", "IMUS", "TRIG"))
        others = [one for one in (frames, imu, triggers) if one is not None]
        facts = self.event_id if self.event_id in self.declared or not others else others[0]
        info = self.declared[facts].info if facts in self.declared else {}
        self.stream = description.stream_info(info)
        if self.event_id < 0 and others and not self.stream.width:
            self.stream = description.stream_info(info, 1, 1)
            if frames is not None:
                sizes = (one.pixels.shape for _, one in self._iterate_packets(file, self._parsers())
                         if isinstance(one, Frame))  # fmt: skip
                height, width = next(sizes, (1, 1))
                self.stream = replace(self.stream, width=width, height=height)
        if not (self.stream.width and self.stream.height):
            width = height = 0
            parsers = {} if self.event_id < 0 else {self.event_id: self._parse_events}
            for number, events in self._iterate_packets(file, parsers, find_events=not parsers):
                assert isinstance(events, np.ndarray)
                self.event_id = number
                width = max(width, 1 + int(events["x"].max()))
                height = max(height, 1 + int(events["y"].max()))
            if not width:
                raise CorruptDataError(
                    "it neither declares nor holds events, nor what comes beside them"
                )
            self.stream = description.stream_info(info, width, height)
            self.integrity = IntegrityReport()
        self.stream = replace(
            self.stream,
            frames=frames is not None,
            imu=imu is not None,
            triggers=triggers is not None,
        )

    def _first_stream(self, kind: str) -> int | None:
        """The id of the first stream of a kind that the file declares for the camera."""
        ids = [number for number, info in self.declared.items() if info.identifier == kind]
        if len(self.streams) > 1:
            camera = self.declared[self.event_id].info.get("source")
            ids = [number for number in ids if self.declared[number].info.get("source") == camera]
        return min(ids, default=None)

    def _count_unread(self, number: int, body: bytes, counted: Collection[str]) -> None:
        """Count what a packet of a stream holds that is not read."""
        other = self.declared.get(number)
        if other is None or other.identifier not in counted:
            return
        try:
            frame = other.identifier == "FRME"
            count = 1 if frame else layout.element_count(self._plain(body))
        except CorruptDataError:
            return
        name = self.streams.get(str(number), other.info.get("source", ""))
        what = of_stream(_UNREAD[other.identifier], str(number), name)
        self.left_out[what] = self.left_out.get(what, 0) + count

    def _parsers(self) -> dict[int, _Parser]:
        """The parsers of the streams that evs reads, by stream id."""
        frames, imu, triggers = (self._first_stream(kind) for kind in ("FRME", "IMUS", "TRIG"))
        parsers: dict[int, _Parser] = {self.event_id: self._parse_events}
        if frames is not None:
            seen = iter(range(self.size))
            parsers[frames] = lambda body: self._parse_frame(body, seen)
        if imu is not None:
            parsers[imu] = lambda body: _or_none(parse_imu(self._plain(body)))
        if triggers is not None:
            parsers[triggers] = lambda body: _or_none(parse_triggers(self._plain(body)))
        return parsers

    def _parse_events(self, body: bytes) -> Events | str | None:
        events = layout.parse_events(self._plain(body))
        if not len(events):
            return None
        steps = np.diff(events["t"])
        if len(steps) and int(steps.min()) < -CLOCK_RESET_US:
            return "its time stamps run backwards"
        return bad_values(events, self.stream) or normalised(events)

    def _parse_frame(self, body: bytes, numbers: Iterator[int]) -> Frame | None:
        plain = self._plain(body)
        try:
            return replace(parse_frame(plain, 0, self.stream.camera), seq=next(numbers))
        except OtherFormatError:
            self.left_out[COLOURED] = self.left_out.get(COLOURED, 0) + 1
            return None

    def _plain(self, body: bytes) -> bytes:
        return compressions.decompress(body, self.compression)

    def _iterate_packets(
        self,
        file: BinaryIO,
        parsers: Mapping[int, _Parser],
        find_events: bool = False,
        counted: Collection[str] = tuple(_UNREAD),
    ) -> Iterator[tuple[int, Message]]:
        """(stream id, message) of every packet that has a taker.

        find_events: the first stream that holds events has one too; counted: the kinds of streams
        that are counted in `left_out` where they have none.
        """
        integrity, whole = IntegrityReport(), 0
        self.left_out = {}
        at, broken, tries = self.packets_at, None, 0
        while at < self.packets_end and tries < MAX_TRIES:
            try:
                number, body = self._packet(file, at)
                if number not in parsers and self._kind(number, body) == b"EVTS" and find_events:
                    parsers, find_events = {number: self._parse_events}, False
                message = self._parsed_message(number, body, parsers)
            except CorruptDataError as reason:
                broken, tries = broken or (at, str(reason)), tries + 1
                at = self._next_packet(file, at + 1)
                continue
            self.position = at
            if broken:
                integrity.corrupt(*broken)
            broken, tries, whole = None, 0, whole + 1
            if number not in parsers:
                self._count_unread(number, body, counted)
            if isinstance(message, str):
                integrity.corrupt(at, message)
            elif message is not None:
                yield number, message
            at += layout.PACKET_HEADER.size + len(body)
        # what no whole packet follows is torn
        integrity.torn_tail(broken[0], self.packets_end) if broken else integrity.torn_tail(
            self.end, self.size
        )
        self.integrity, self.whole_packets = integrity, whole

    def _parsed_message(
        self, number: int, body: bytes, parsers: Mapping[int, _Parser]
    ) -> Message | str | None:
        """What is in a packet; words where one of another kind than events is damaged inside.

        Such a packet is passed by its length, as by a walk that does not look into it: so every
        walk over a file finds the same events.
        """
        if number not in parsers:
            return None
        if number == self.event_id or number not in self.declared:
            return parsers[number](body)
        self._kind(number, body)
        try:
            return parsers[number](body)
        except CorruptDataError as reason:
            return str(reason)

    def _packet(self, file: BinaryIO, at: int) -> tuple[int, bytes]:
        """Stream id and body of the packet at a byte offset."""
        file.seek(at)
        prefix = file.read(layout.PACKET_HEADER.size)
        if len(prefix) < layout.PACKET_HEADER.size:
            raise CorruptDataError("the packet's header is torn")
        number, length = layout.PACKET_HEADER.unpack(prefix)
        if not _MIN_BODY_BYTES <= length <= self.packets_end - at - len(prefix):
            raise CorruptDataError(f"a packet of {length} bytes does not fit the file")
        return number, file.read(length)

    def _next_packet(self, file: BinaryIO, start: int) -> int:
        """Offset at or after `start` at which a packet may begin, by what its body begins with."""
        # a plain buffer begins with 8 bytes of offsets and its identifier, a frame with its magic
        magic, lead = compressions.MAGIC.get(self.compression), layout.PACKET_HEADER.size
        marker = _PLAIN_KINDS if magic is None else re.compile(re.escape(magic))
        if magic is None:
            lead += 8
        at = start + lead
        while at < self.packets_end:
            file.seek(at)
            chunk = file.read(min(_CHUNK_BYTES, self.packets_end - at))
            found = marker.search(chunk)
            if found:
                return at + found.start() - lead
            # all markers have four bytes
            at += max(1, len(chunk) - 3)
        return self.packets_end

    def _kind(self, number: int, body: bytes) -> bytes:
        """The identifier of a packet of another stream, which must be the one it declares."""
        kind = compressions.identifier(body, self.compression)
        declared = self.declared.get(number)
        if declared is not None and declared.identifier:
            if declared.identifier.encode() != kind:
                raise CorruptDataError(f"stream {number} holds {declared.identifier}, not {kind!r}")
        elif self.declared or not (kind.isalnum() and kind.isupper()):
            raise CorruptDataError(f"stream {number} is not declared")
        return kind


def _or_none(found: ImuSamples | Triggers) -> ImuSamples | Triggers | None:
    """The samples or triggers; None if there are none."""
    return found if len(found) else None


def _table(file: BinaryIO, position: int, size: int, compression: str) -> tuple[int, int | None]:
    """Read the data table at a byte offset.

    Args:
        file: The file.
        position: Byte offset of the table.
        size: Size of the file, bytes.
        compression: none, lz4 or zstd.

    Returns:
        Byte offset at which the valid content ends, and the number of packets in the table; the
        file's size and None if the table is not whole.
    """
    file.seek(position)
    head = file.read(_TABLE_HEAD_BYTES)
    try:
        if compressions.identifier(head, compression) != b"FTAB":
            return size, None
        body = head + file.read(size - position - len(head))
        body = body[: compressions.frame_bytes(body, compression)]
        listed = layout.parse_table_length(compressions.decompress(body, compression))
        return position + len(body), listed
    except CorruptDataError:
        return size, None
