"""AEDAT4's bytes: magic line, IOHeader, packets, data table. The only door to flatbuffers.

A file is

    magic | IOHeader | packet, packet, ... | data table (optional)

IOHeader, packet bodies and the table are size-prefixed flatbuffers; bodies and the table are
compressed. A packet is int32 stream id, int32 body size, body. All numbers are little-endian.
Schemas: dv-processing's IOHeader ("IOHE"), EventPacket ("EVTS"), FileDataTable ("FTAB").

Our event is the schema's event struct byte for byte, so that a constant prefix in front of the
events is the whole encoder; the data table is laid out by numpy, since the builder would take
10 us a packet. What is read is checked, which the library does not do: every offset and length lies
inside the bytes given, or CorruptDataError says what is wrong.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import flatbuffers
import numpy as np
import numpy.typing as npt

from evs.msgs import EVENT_DTYPE, Events, clean_events

MAGIC = b"#!AER-DAT4.0\r\n"

PACKET_HEADER = struct.Struct("<ii")
"""Stream id and size of the body in bytes."""

NO_TABLE = -1

_EVENTS_PREFIX = struct.Struct("<II4s2xHHHiII")

TABLE_COLUMNS = 5
"""Per packet: offset of its body, size of its body, events, first and last time stamp (us)."""

_TABLE_PREFIX = struct.Struct("<II4s2xHHHiI")
_TABLE_ENTRY = np.dtype(
    [
        ("vtable", "<i4"),
        ("stream", "<i4"),
        ("size", "<i4"),
        ("offset", "<i8"),
        ("elements", "<i8"),
        ("start", "<i8"),
        ("end", "<i8"),
        ("pad", "<i4"),
    ]
)
_TABLE_VTABLE = struct.Struct("<7H")


class CorruptDataError(Exception):
    """The bytes do not fit the format; the message is the reason. Never reaches users."""


def io_header(compression: int, xml: str, table_position: int = NO_TABLE) -> bytes:
    """The IOHeader with its size prefix. Its length does not depend on the table position."""
    builder = flatbuffers.Builder(len(xml) + 64)
    builder.ForceDefaults(True)
    text = builder.CreateString(xml)
    builder.StartObject(3)
    builder.PrependInt64Slot(1, table_position, 0)
    builder.PrependUOffsetTRelativeSlot(2, text, 0)
    builder.PrependInt32Slot(0, compression, 0)
    builder.FinishSizePrefixed(builder.EndObject(), file_identifier=b"IOHE")
    return bytes(builder.Output())


@dataclass(frozen=True)
class IOHeader:
    """The content of an IOHeader."""

    compression: int
    """dv-processing's CompressionType"""
    table_position: int
    """of the data table in the file; NO_TABLE or an impossible value: it has none"""
    table_position_at: int | None
    """where that number lies in the header, from its size prefix; None: it is left out"""
    xml: str


def parse_io_header(body: bytes) -> IOHeader:
    """The content of an IOHeader with its size prefix."""
    flat = Flat(body, b"IOHE")
    table = flat.root()
    compression_at, position_at, text_at = (flat.field(table, index) for index in range(3))
    compression = 0 if compression_at is None else flat.number("<i", compression_at)
    position = NO_TABLE if position_at is None else flat.number("<q", position_at)
    if text_at is None:
        raise CorruptDataError("the header has no stream description")
    start, length = flat.vector(text_at, 1)
    try:
        xml = body[start : start + length].decode()
    except UnicodeDecodeError:
        raise CorruptDataError("the stream description is not UTF-8") from None
    return IOHeader(compression, position, position_at, xml)


def events_body(events: Events) -> bytes:
    """An uncompressed packet body: 32 constant bytes and the events as they are in memory."""
    data = clean_events(events).view(np.uint8).data
    size = _EVENTS_PREFIX.size + data.nbytes
    return b"".join(
        (_EVENTS_PREFIX.pack(size - 4, 16, b"EVTS", 6, 8, 4, 6, 4, len(events)), data),
    )


def parse_events(body: bytes) -> Events:
    """The events of an uncompressed packet body, a read-only view of its bytes."""
    flat = Flat(body, b"EVTS")
    elements_at = flat.field(flat.root(), 0)
    if elements_at is None:
        return np.frombuffer(b"", EVENT_DTYPE)
    start, count = flat.vector(elements_at, EVENT_DTYPE.itemsize)
    return np.frombuffer(body, EVENT_DTYPE, count, start)


def data_table(
    stream: npt.ArrayLike, columns: npt.NDArray[np.int64], padding: bytes = b""
) -> bytes:
    """The uncompressed data table of packets.

    Args:
        stream: (n,) number of each packet's stream, or one number for all.
        columns: (n, TABLE_COLUMNS) int64.
        padding: A multiple of 8 bytes in front of the list, without a meaning.
    """
    count = len(columns)
    # at `listed` the offsets of the n entries, then their one vtable, then they, at 4 mod 8
    listed = _TABLE_PREFIX.size + len(padding) + 4
    vtable_at = listed + 4 * count
    entries_at = vtable_at + _TABLE_VTABLE.size
    entries_at += (4 - entries_at) % 8
    entries = np.zeros(count, _TABLE_ENTRY)
    positions = entries_at + _TABLE_ENTRY.itemsize * np.arange(count)
    entries["vtable"] = positions - vtable_at
    entries["stream"] = stream
    for column, name in enumerate(("offset", "size", "elements", "start", "end")):
        entries[name] = columns[:, column]
    offsets = (positions - listed - 4 * np.arange(count)).astype("<u4")
    vtable = _TABLE_VTABLE.pack(14, 44, 12, 4, 20, 28, 36)
    vtable += bytes(entries_at - vtable_at - len(vtable))
    size = entries_at + entries.nbytes
    prefix = _TABLE_PREFIX.pack(size - 4, 16, b"FTAB", 6, 8, 4, 6, 4 + len(padding))
    length = struct.pack("<I", count)
    return b"".join((prefix, padding, length, offsets.tobytes(), vtable, entries.tobytes()))


def parse_table_length(body: bytes) -> int:
    """How many packets an uncompressed data table lists."""
    flat = Flat(body, b"FTAB")
    elements_at = flat.field(flat.root(), 0)
    return 0 if elements_at is None else flat.vector(elements_at, 4)[1]


def element_count(body: bytes) -> int:
    """How many events, IMU samples or triggers an uncompressed packet body lists."""
    flat = Flat(body, body[8:12])
    elements_at = flat.field(flat.root(), 0)
    return 0 if elements_at is None else flat.vector(elements_at, 4)[1]


def list_body(builder: flatbuffers.Builder, tables: list[int], identifier: bytes) -> bytes:
    """The packet body whose root holds nothing but a vector of these tables, in order."""
    builder.StartVector(4, len(tables), 4)
    for table in reversed(tables):
        builder.PrependUOffsetTRelative(table)
    vector = builder.EndVector()
    builder.StartObject(1)
    builder.PrependUOffsetTRelativeSlot(0, vector, 0)
    builder.FinishSizePrefixed(builder.EndObject(), file_identifier=identifier)
    return bytes(builder.Output())


class Flat:
    """Bounds-checked look into one size-prefixed flatbuffer. Positions count from the prefix."""

    def __init__(self, body: bytes, identifier: bytes) -> None:
        self.body = body
        if len(body) < 12 or body[8:12] != identifier:
            raise CorruptDataError(f"not a {identifier.decode()} buffer")
        if self.number("<I", 0) != len(body) - 4:
            raise CorruptDataError(
                f"{identifier.decode()} buffer of {len(body)} bytes states another"
            )

    def number(self, kind: str, position: int) -> int:
        """One little-endian integer."""
        if position < 0 or position + struct.calcsize(kind) > len(self.body):
            raise CorruptDataError(
                f"offset {position} is outside a buffer of {len(self.body)} bytes"
            )
        value: tuple[Any, ...] = struct.unpack_from(kind, self.body, position)
        return int(value[0])

    def real(self, position: int) -> float:
        """One little-endian float32."""
        if position < 0 or position + 4 > len(self.body):
            raise CorruptDataError(
                f"offset {position} is outside a buffer of {len(self.body)} bytes"
            )
        value: tuple[float] = struct.unpack_from("<f", self.body, position)
        return value[0]

    def root(self) -> int:
        """Position of the root table."""
        return 4 + self.number("<I", 4)

    def field(self, table: int, index: int) -> int | None:
        """Position of field `index` of a table; None where the field is left at its default."""
        vtable = table - self.number("<i", table)
        slot = 4 + 2 * index
        if slot >= self.number("<H", vtable):
            return None
        offset = self.number("<H", vtable + slot)
        return table + offset if offset else None

    def vector(self, position: int, item_bytes: int) -> tuple[int, int]:
        """Start and length of the vector (or string) that the field at `position` points to."""
        at = position + self.number("<I", position)
        length = self.number("<I", at)
        if at + 4 + length * item_bytes > len(self.body):
            raise CorruptDataError(f"{length} items do not fit a buffer of {len(self.body)} bytes")
        return at + 4, length
