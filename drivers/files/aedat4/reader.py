"""Aedat4File: any AEDAT4 file as a stream of event packets, whatever state its bytes are in."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from evs.drivers.files.aedat4 import compression as compressions
from evs.drivers.files.aedat4 import description, layout
from evs.drivers.files.aedat4.layout import DamageError
from evs.drivers.files.damage import Damage, bad_values, normalised
from evs.drivers.files.recording import existing
from evs.msgs import Events, EvsError, StreamInfo

MAX_HEADER_BYTES = 1 << 26
MAX_TRIES = 1000
"""After damage, so many places that look like a packet are tried before the rest is given up."""

_TABLE_HEAD_BYTES = 1 << 23
_CHUNK_BYTES = 1 << 20
_MIN_BODY_BYTES = 12


@dataclass
class Aedat4File:
    """One AEDAT4 file, ours or another writer's, opened with `Aedat4File.at(path)`.

    Events come from the first event stream that the file declares (or holds, if it declares none);
    frames, IMU and triggers are skipped. Bytes that do not check out are left out and reported:
    as damaged packets where a whole packet follows somewhere, else as a torn tail.
    """

    path: Path
    stream: StreamInfo
    compression: str
    streams: dict[int, description.Declared]
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
    damage: Damage = field(default_factory=Damage)
    """what the last complete walk over `events` found"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> Aedat4File:
        """Read the header. EvsError: no such file, not AEDAT4, no events in it."""
        found = existing(path)
        try:
            with found.open("rb") as file:
                return cls._opened(found, file)
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        except DamageError as reason:
            raise EvsError(f"{found} is not a readable AEDAT4 file: {reason}") from None

    def events(self) -> Iterator[Events]:
        """The events of each packet, read-only arrays that are never empty; then sets `damage`."""
        with self.path.open("rb") as file:
            for _, events in self._walk(file, self.event_id):
                yield events

    @property
    def broken_pointer(self) -> bool:
        """The header points to a data table that is not there: dv-processing refuses the file."""
        return self.header.table_position > 0 and self.table_packets is None

    def first_packet_fits(self) -> bool:
        """There is a first packet and, by its stated length, it is not torn."""
        with self.path.open("rb") as file:
            try:
                self._packet(file, self.packets_at)
            except DamageError:
                return False
        return True

    @classmethod
    def _opened(cls, path: Path, file: BinaryIO) -> Aedat4File:
        size = os.fstat(file.fileno()).st_size
        if file.read(len(layout.MAGIC)) != layout.MAGIC:
            raise DamageError("it does not begin with the AEDAT4 line")
        prefix = file.read(4)
        length = int.from_bytes(prefix, "little")
        packets_at = len(layout.MAGIC) + 4 + length
        if len(prefix) < 4 or packets_at > size or length > MAX_HEADER_BYTES:
            raise DamageError("its header is torn")
        header = layout.parse_io_header(prefix + file.read(length))
        if header.compression not in compressions.NAMES:
            raise DamageError(f"compression {header.compression} does not exist")
        compression = compressions.NAMES[header.compression]
        streams = description.from_xml(header.xml)
        end, table_packets = size, None
        if packets_at <= header.table_position < size:
            end, table_packets = _table(file, header.table_position, size, compression)
        whole = table_packets is not None
        ids = [number for number, kind in sorted(streams.items()) if kind.identifier == "EVTS"]
        opened = cls(
            path=path,
            stream=StreamInfo(0, 0),
            compression=compression,
            streams=streams,
            header=header,
            event_id=ids[0] if ids else -1,
            packets_at=packets_at,
            packets_end=header.table_position if whole else size,
            table_packets=table_packets,
            end=end,
            size=size,
        )
        opened._find_stream(file)
        return opened

    def _find_stream(self, file: BinaryIO) -> None:
        """Take the stream's facts from the description, or else from the packets."""
        info = self.streams[self.event_id].info if self.event_id in self.streams else {}
        self.stream = description.stream_info(info)
        if self.stream.width and self.stream.height:
            return
        width = height = 0
        for number, events in self._walk(file, None if self.event_id < 0 else self.event_id):
            self.event_id = number
            width = max(width, 1 + int(events["x"].max()))
            height = max(height, 1 + int(events["y"].max()))
        if not width:
            raise DamageError("it neither declares nor holds an event stream")
        self.stream = description.stream_info(info, width, height)
        self.damage = Damage()

    def _walk(self, file: BinaryIO, event_id: int | None) -> Iterator[tuple[int, Events]]:
        """(stream id, events) of every event packet; event_id None: of the first stream found."""
        damage = Damage()
        at, broken, tries = self.packets_at, None, 0
        while at < self.packets_end and tries < MAX_TRIES:
            try:
                number, body = self._packet(file, at)
                if number != event_id and self._kind(number, body) == b"EVTS" and event_id is None:
                    event_id = number
                events = self._events(body) if number == event_id else None
            except DamageError as reason:
                broken, tries = broken or (at, str(reason)), tries + 1
                at = self._next_packet(file, at + 1)
                continue
            if broken:
                damage.packet(*broken)
            broken, tries = None, 0
            if events is not None and len(events):
                wrong = bad_values(events, self.stream)
                if wrong:
                    damage.packet(at, wrong)
                else:
                    yield number, normalised(events)
            at += layout.PACKET_HEADER.size + len(body)
        # what no whole packet follows is torn
        damage.tail(broken[0], self.packets_end) if broken else damage.tail(self.end, self.size)
        self.damage = damage

    def _packet(self, file: BinaryIO, at: int) -> tuple[int, bytes]:
        """Stream id and body of the packet at a byte offset."""
        file.seek(at)
        prefix = file.read(layout.PACKET_HEADER.size)
        if len(prefix) < layout.PACKET_HEADER.size:
            raise DamageError("the packet's header is torn")
        number, length = layout.PACKET_HEADER.unpack(prefix)
        if not _MIN_BODY_BYTES <= length <= self.packets_end - at - len(prefix):
            raise DamageError(f"a packet of {length} bytes does not fit the file")
        return number, file.read(length)

    def _next_packet(self, file: BinaryIO, start: int) -> int:
        """Offset at or after `start` at which a packet may begin, by what its body begins with."""
        # a plain buffer begins with 8 bytes of offsets and its identifier, a frame with its magic
        marker, lead = compressions.MAGIC.get(self.compression, b"EVTS"), layout.PACKET_HEADER.size
        if self.compression == "none":
            lead += 8
        at = start + lead
        while at < self.packets_end:
            file.seek(at)
            chunk = file.read(min(_CHUNK_BYTES, self.packets_end - at))
            found = chunk.find(marker)
            if found >= 0:
                return at + found - lead
            at += max(1, len(chunk) - len(marker) + 1)
        return self.packets_end

    def _events(self, body: bytes) -> Events:
        return layout.parse_events(compressions.decompress(body, self.compression))

    def _kind(self, number: int, body: bytes) -> bytes:
        """The identifier of a packet of another stream, which must be the one it declares."""
        kind = compressions.identifier(body, self.compression)
        declared = self.streams.get(number)
        if declared is not None and declared.identifier:
            if declared.identifier.encode() != kind:
                raise DamageError(f"stream {number} holds {declared.identifier}, not {kind!r}")
        elif self.streams or not (kind.isalnum() and kind.isupper()):
            raise DamageError(f"stream {number} is not declared")
        return kind


def _table(file: BinaryIO, position: int, size: int, compression: str) -> tuple[int, int | None]:
    """Out: (where the file's whole content ends, packets listed) of the table at `position`."""
    file.seek(position)
    head = file.read(_TABLE_HEAD_BYTES)
    try:
        if compressions.identifier(head, compression) != b"FTAB":
            return size, None
        body = head + file.read(size - position - len(head))
        body = body[: compressions.frame_bytes(body, compression)]
        listed = layout.parse_table_length(compressions.decompress(body, compression))
        return position + len(body), listed
    except DamageError:
        return size, None
