"""The records of bags, read without the bag's own index, so that torn bags are read too."""

from __future__ import annotations

import bz2
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from evs.drivers.files.aedat4.compression import MAX_BODY_BYTES, expanded
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.integrity import IntegrityReport

MCAP_MAGIC = b"\x89MCAP0\r\n"
ROS1_MAGIC = b"#ROSBAG V2.0\n"


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag, as bytes."""

    topic: str
    kind: str
    """its type, as in dvs_msgs/msg/EventArray"""
    data: bytes
    at: int
    """byte offset of its record, or of the chunk that it is in"""


@dataclass
class BagScan:
    """One pass over a bag; `kinds` grows on the way, `integrity` is complete at the end."""

    integrity: IntegrityReport = field(default_factory=IntegrityReport)
    kinds: dict[str, str] = field(default_factory=dict)
    """topic -> type, for the topics declared so far"""


def scan_mcap(path: Path, scan: BagScan) -> Iterator[BagMessage]:
    """Every message of an MCAP file, in the file's order. CorruptDataError: it is not MCAP."""
    with path.open("rb") as file:
        yield from _scan_mcap(file, path.stat().st_size, scan)


def _scan_mcap(file: BinaryIO, size: int, scan: BagScan) -> Iterator[BagMessage]:
    if file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
        raise CorruptDataError("it does not begin as MCAP does")
    declared = _McapNames(scan)
    at = len(MCAP_MAGIC)
    while at < size:
        file.seek(at)
        head = file.read(9)
        # data end, or the footer: what follows is an index
        if head[:1] in (b"\x0f", b"\x02"):
            return
        length = int.from_bytes(head[1:], "little")
        if len(head) < 9 or length > size - at - 9:
            scan.integrity.torn_tail(at, size)
            return
        # what we do not look into is passed over
        if head[0] in _MCAP_READ:
            yield from declared.messages_in(head[0], file.read(length), at)
        at += 9 + length


_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = _MCAP_READ = (3, 4, 5, 6)


class _McapNames:
    """The schemas and channels of an MCAP file by number."""

    def __init__(self, scan: BagScan) -> None:
        self.scan = scan
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, tuple[str, str]] = {}

    def messages_in(self, op: int, body: bytes, at: int) -> Iterator[BagMessage]:
        """The messages in one record; corrupt ones are reported."""
        try:
            if op == _SCHEMA:
                self.schemas[_u16(body, 0)] = _text(body, 2)[0]
            elif op == _CHANNEL:
                topic, kind = _text(body, 4)[0], self.schemas.get(_u16(body, 2), "")
                self.channels[_u16(body, 0)] = topic, kind
                self.scan.kinds[topic] = kind
            elif op == _MESSAGE and _u16(body, 0) in self.channels:
                yield BagMessage(*self.channels[_u16(body, 0)], body[22:], at)
            elif op == _CHUNK:
                for inner, part in _mcap_records(_mcap_chunk(body)):
                    # no chunk is in another
                    if inner != _CHUNK:
                        yield from self.messages_in(inner, part, at)
        except (struct.error, CorruptDataError) as reason:
            self.scan.integrity.corrupt(at, str(reason))


def _mcap_chunk(body: bytes) -> bytes:
    """The records in a chunk."""
    size, crc = struct.unpack_from("<16xQI", body)
    compression, at = _text(body, 28)
    packed = body[at + 8 : at + 8 + struct.unpack_from("<Q", body, at)[0]]
    if size > MAX_BODY_BYTES:
        raise CorruptDataError(f"a chunk states {size} bytes")
    if compression not in ("", "lz4", "zstd"):
        raise CorruptDataError(f"a chunk's compression {compression[:20]!r} does not exist")
    records = expanded(packed, compression, size) if compression else packed
    if len(records) != size or (crc and zlib.crc32(records) != crc):
        raise CorruptDataError("a chunk is damaged, its checksum says")
    return records


def _mcap_records(records: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(records):
        op, length = struct.unpack_from("<BQ", records, at)
        if length > len(records) - at - 9:
            raise CorruptDataError("a record does not fit into its chunk")
        yield op, records[at + 9 : at + 9 + length]
        at += 9 + length


def scan_ros1(path: Path, scan: BagScan) -> Iterator[BagMessage]:
    """Every message of a ROS 1 bag, in the file's order. CorruptDataError: it is not a bag."""
    with path.open("rb") as file:
        yield from _scan_ros1(file, path.stat().st_size, scan)


def _scan_ros1(file: BinaryIO, size: int, scan: BagScan) -> Iterator[BagMessage]:
    if file.read(len(ROS1_MAGIC)) != ROS1_MAGIC:
        raise CorruptDataError("it does not begin as a ROS 1 bag does")
    connections: dict[int, tuple[str, str]] = {}

    def messages_in(fields: dict[bytes, bytes], data: bytes, at: int) -> Iterator[BagMessage]:
        op = fields.get(b"op", b"")
        try:
            if op == b"\x07":
                topic, connection = fields[b"topic"].decode(), ros1_fields(data)
                package, _, name = connection[b"type"].decode().partition("/")
                connections[_u32(fields[b"conn"], 0)] = topic, f"{package}/msg/{name}"
                scan.kinds[topic] = f"{package}/msg/{name}"
            elif op == b"\x02" and _u32(fields[b"conn"], 0) in connections:
                yield BagMessage(*connections[_u32(fields[b"conn"], 0)], data, at)
            elif op == b"\x05":
                for _, inner, _, part in ros1_chunk_records(ros1_chunk(fields, data)):
                    if inner.get(b"op") != b"\x05":
                        yield from messages_in(inner, part[4:], at)
        except (struct.error, KeyError, UnicodeDecodeError, CorruptDataError) as reason:
            scan.integrity.corrupt(at, f"a record lacks {reason}")

    end = len(ROS1_MAGIC)
    for record in ros1_file_records(file, size):
        yield from messages_in(record.fields, record.data[4:], record.at)
        end = record.end
    scan.integrity.torn_tail(end, size)


@dataclass(frozen=True)
class Ros1Record:
    """One record of a ROS 1 bag, outside of chunks."""

    at: int
    """byte offset"""
    head: bytes
    """with its length"""
    data: bytes
    """with its length"""

    @property
    def end(self) -> int:
        """Byte offset."""
        return self.at + len(self.head) + len(self.data)

    @property
    def fields(self) -> dict[bytes, bytes]:
        """name -> value of its header."""
        return ros1_fields(self.head[4:])


def ros1_file_records(file: BinaryIO, size: int) -> Iterator[Ros1Record]:
    """The whole records of a bag of `size` bytes, up to the first torn one."""
    at = len(ROS1_MAGIC)
    while at < size:
        file.seek(at)
        parts = []
        for _ in range(2):
            length_bytes = file.read(4)
            length = int.from_bytes(length_bytes, "little")
            if len(length_bytes) < 4 or length > size - file.tell():
                return
            parts.append(length_bytes + file.read(length))
        record = Ros1Record(at, *parts)
        yield record
        at = record.end


def ros1_fields(head: bytes) -> dict[bytes, bytes]:
    """The fields `name=value` of a record's header."""
    fields, at = {}, 0
    while at + 4 <= len(head):
        end = at + 4 + _u32(head, at)
        name, _, value = head[at + 4 : end].partition(b"=")
        fields[name], at = value, end
    return fields


def ros1_chunk_records(records: bytes) -> Iterator[tuple[int, dict[bytes, bytes], bytes, bytes]]:
    """(offset, fields, header, data, each with its length) of each record in a chunk."""
    at = 0
    while at < len(records):
        middle = at + 4 + _u32(records, at)
        end = middle + 4 + _u32(records, middle)
        if end > len(records):
            raise CorruptDataError("whole records in its chunk")
        yield at, ros1_fields(records[at + 4 : middle]), records[at:middle], records[middle:end]
        at = end


def ros1_chunk(fields: dict[bytes, bytes], data: bytes) -> bytes:
    """The records in a chunk."""
    compression, size = fields[b"compression"], _u32(fields[b"size"], 0)
    if size > MAX_BODY_BYTES:
        raise CorruptDataError(f"a chunk of a size that exists: it states {size} bytes")
    if compression == b"bz2":
        try:
            data = bz2.BZ2Decompressor().decompress(data, size + 1)
        except OSError as reason:
            raise CorruptDataError(str(reason)) from None
    elif compression == b"lz4":
        data = expanded(data, "lz4", size)
    elif compression != b"none":
        raise CorruptDataError(f"a compression that exists: it says {compression[:20]!r}")
    if len(data) != size:
        raise CorruptDataError(f"{size} bytes in its chunk")
    return data


def _u16(data: bytes, at: int) -> int:
    return int(struct.unpack_from("<H", data, at)[0])


def _u32(data: bytes, at: int) -> int:
    return int(struct.unpack_from("<I", data, at)[0])


def _text(data: bytes, at: int) -> tuple[str, int]:
    """A string with its length in front, and where it ends."""
    end = at + 4 + _u32(data, at)
    return data[at + 4 : end].decode(errors="replace"), end
