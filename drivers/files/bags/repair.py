"""Bags whose recorder was killed, made as readers that want an index expect them.

MCAP: what follows the last whole record is cut, and the file's end is written; a summary is
optional. ROS 1: the index of the chunks is made anew. SQLite: the transaction that was cut off is
taken back.
"""

from __future__ import annotations

import struct
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.bags.database import journal_of, open_database
from evs.drivers.files.bags.reader import BagFile
from evs.drivers.files.bags.records import (
    MCAP_MAGIC,
    ROS1_MAGIC,
    Ros1Record,
    ros1_chunk,
    ros1_chunk_records,
    ros1_file_records,
)
from evs.drivers.files.formats import PACKED_SUFFIX
from evs.drivers.files.integrity import Repair
from evs.drivers.files.paths import target_error
from evs.msgs import EvsError

_DATA_END = b"\x0f" + struct.pack("<QI", 4, 0)
_FOOTER = b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0)
MCAP_END = _DATA_END + _FOOTER + MCAP_MAGIC
"""The end of a file without a summary."""

_BAG_HEADER_BYTES = 4096
"""size of the first record where it is torn; ROS's own bags have 8 more"""


def repair(path: Path) -> Repair:
    """Cut a torn tail and write the end of the file. EvsError: not a bag, or not writable."""
    if path.is_dir() or path.name.endswith(PACKED_SUFFIX):
        raise EvsError(f"{path} is not one plain file: repair the .mcap or .db3 files of the bag")
    file = BagFile.at(path)
    try:
        if path.suffix.lower() == ".db3":
            return _repair_database(path)
        with path.open("r+b") as target:
            return (_repair_ros1 if file.ros == 1 else _repair_mcap)(path, target, file.size)
    except OSError as reason:
        raise target_error(path, reason) from None


def _repair_database(path: Path) -> Repair:
    there = journal_of(path) is not None
    with closing(open_database(path)) as bag:
        bag.execute("SELECT count(*) FROM main.topics").fetchone()
    if journal_of(path) is not None:
        raise EvsError(f"cannot take back the journal beside {path}: make both writable")
    done = "took back what was not complete" if there else ""
    return Repair(path, 0, path.stat().st_size, False, done)


def _repair_mcap(path: Path, target: BinaryIO, size: int) -> Repair:
    at = len(MCAP_MAGIC)
    while at < size:
        target.seek(at)
        head = target.read(9)
        length = int.from_bytes(head[1:], "little")
        if head[:1] == b"\x0f" or len(head) < 9 or length > size - at - 9:
            break
        at += 9 + length
    target.seek(max(0, size - len(MCAP_MAGIC)))
    if target.read() == MCAP_MAGIC and at < size:
        return Repair(path, 0, size, False)
    target.truncate(at)
    target.seek(at)
    target.write(MCAP_END)
    return Repair(path, size - at, at + len(MCAP_END), False, "wrote the file's end")


@dataclass
class _Chunk:
    """A chunk of a ROS 1 bag: connection -> (time as bytes, offset) of each message."""

    at: int
    end: int
    messages: dict[int, list[tuple[bytes, int]]] = field(default_factory=dict)


def _repair_ros1(path: Path, target: BinaryIO, size: int) -> Repair:
    # each record once, in their order: a damaged one may have the number of another
    connections: dict[bytes, None] = {}
    chunks: list[_Chunk] = []
    indexed = whole = len(ROS1_MAGIC)
    header_end = messages_end = len(ROS1_MAGIC) + _BAG_HEADER_BYTES
    for record in ros1_file_records(target, size):
        whole, fields = record.end, record.fields
        if fields.get(b"op") == b"\x03":
            header_end = messages_end = record.end
            indexed = int.from_bytes(fields.get(b"index_pos", b"")[:8], "little")
        elif fields.get(b"op") == b"\x05":
            chunks.append(_Chunk(record.at, record.end))
            # what cannot be read is not in the index
            with suppress(CorruptDataError, struct.error, KeyError):
                _index_chunk(chunks[-1], record, connections)
        elif fields.get(b"op") == b"\x07":
            connections[record.head + record.data] = None
        elif fields.get(b"op") == b"\x02":
            messages_end = record.end
    if 0 < indexed < size == whole:
        return Repair(path, 0, size, False)
    end = max(messages_end, chunks[-1].end if chunks else 0)
    if header_end < len(ROS1_MAGIC) + len(_bag_header(0, 0, 0, 0)):
        raise EvsError(f"{path}: its first record has no room for an index: evs convert reads it")
    target.truncate(end)
    target.seek(end)
    if chunks:
        target.write(_index_data(chunks[-1]))
    index_at = target.tell()
    target.write(b"".join(connections) + b"".join(_chunk_info(one) for one in chunks))
    after = target.tell()
    target.seek(len(ROS1_MAGIC))
    target.write(_bag_header(header_end, index_at, len(connections), len(chunks)))
    return Repair(path, size - end, after, False, "made the index anew")


def _index_chunk(chunk: _Chunk, record: Ros1Record, connections: dict[bytes, None]) -> None:
    """Add the content of a chunk to the index."""
    records = ros1_chunk(record.fields, record.data[4:])
    for at, fields, head, body in ros1_chunk_records(records):
        if fields.get(b"op") == b"\x07":
            connections[head + body] = None
        elif fields.get(b"op") == b"\x02":
            chunk.messages.setdefault(_u32(fields[b"conn"]), []).append((fields[b"time"], at))


def _index_data(chunk: _Chunk) -> bytes:
    out = b""
    for number, messages in chunk.messages.items():
        fields = _fields(
            op=b"\x04", ver=_u32_bytes(1), conn=_u32_bytes(number), count=_u32_bytes(len(messages))
        )
        body = b"".join(time + _u32_bytes(at) for time, at in messages)
        out += fields + _u32_bytes(len(body)) + body
    return out


def _chunk_info(chunk: _Chunk) -> bytes:
    times = [time for messages in chunk.messages.values() for time, _ in messages]
    times.sort(key=lambda time: struct.unpack("<II", time))
    first, last = (times[0], times[-1]) if times else (bytes(8), bytes(8))
    fields = _fields(
        op=b"\x06",
        ver=_u32_bytes(1),
        chunk_pos=chunk.at.to_bytes(8, "little"),
        start_time=first,
        end_time=last,
        count=_u32_bytes(len(chunk.messages)),
    )
    body = b"".join(
        _u32_bytes(number) + _u32_bytes(len(encoded)) for number, encoded in chunk.messages.items()
    )
    return fields + _u32_bytes(len(body)) + body


def _bag_header(end: int, index_at: int, connections: int, chunks: int) -> bytes:
    """The first record, padded so that the next one begins at `end`."""
    fields = _fields(
        op=b"\x03",
        index_pos=index_at.to_bytes(8, "little"),
        conn_count=_u32_bytes(connections),
        chunk_count=_u32_bytes(chunks),
    )
    padding = max(0, end - len(ROS1_MAGIC) - 4 - len(fields))
    return fields + _u32_bytes(padding) + b" " * padding


def _fields(**fields: bytes) -> bytes:
    """A record's header, with its length."""
    encoded = b"".join(
        _u32_bytes(len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in fields.items()
    )
    return _u32_bytes(len(encoded)) + encoded


def _u32_bytes(number: int) -> bytes:
    return number.to_bytes(4, "little")


def _u32(data: bytes) -> int:
    return int(struct.unpack_from("<I", data)[0])
