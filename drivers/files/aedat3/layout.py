"""AEDAT3.1's bytes: header lines, then packets that count the clock's wraps. All little-endian.

    packet   i16 type, i16 source, i32 event's size, i32 offset of the stamp in it,
             i32 overflows of the stamps, i32 capacity, i32 events, i32 valid events; then they
    1 polarity  u32 data: bit 0 valid, 1 polarity, 2-16 y, 17-31 x, from the upper left; i32 stamp
    2 frame     u32 info: bit 0 valid, 1-3 channels, 4-7 colour filter, 8-14 region; i32 stamps of
                the frame's begin and end and of its exposure's; i32 width, height, x, y; u16 pixels
    3 IMU6      u32 info; i32 stamp; f32 acceleration (3), g; angular velocity (3), degrees/s;
                temperature, degrees C
    4 IMU9      the same, then f32 compass (3)

t = overflows * 2^31 + stamp, us. In cAER's compressed files (compressed.py) bit 15 of the type says
that a packet is compressed, and `capacity` how many bytes follow its header. Source: iniVation's
description of the format, and libcaer's headers.
"""

from __future__ import annotations

import re
import struct
from typing import BinaryIO, NamedTuple

import numpy as np

MAGIC = b"#!AER-DAT3.1"
END = b"#!END-HEADER"
EVS_LINE = "#evs "
SOURCE = "#Source "
"""start of the line that names the camera, after its number"""
SPAN_US = 1 << 31

SPECIAL, POLARITY, FRAME, IMU6, IMU9 = range(5)
OTHERS = {SPECIAL: "special events"}
OTHER_KINDS = "events of other kinds"
COMPRESSED = 0x8000

EVENT = np.dtype([("data", "<u4"), ("stamp", "<i4")])
_IMU_FIELDS = [
    ("info", "<u4"),
    ("stamp", "<i4"),
    ("acceleration", "<f4", (3,)),
    ("angular_velocity", "<f4", (3,)),
    ("temperature", "<f4"),
]
IMU = {IMU6: np.dtype(_IMU_FIELDS), IMU9: np.dtype([*_IMU_FIELDS, ("compass", "<f4", (3,))])}
"""Kind of packet -> its samples."""

FRAME_HEAD = struct.Struct("<I8i")
FRAME_STAMP_AT = 12
"""offset of a frame's time stamp in libcaer's headers: the start of the exposure"""

SIZES = {POLARITY: (8, 4), IMU6: (36, 4), IMU9: (48, 4)}
"""Kind -> size of an event, offset of its stamp."""

MARK = re.compile(rb"[\x08\x24\x30]\0\0\0\x04\0\0\0")
"""these two in a packet's header, for the search after corrupt data"""

MARK_AT = 4
MAX_EVENT_BYTES = 1 << 28

NUMBERS = struct.Struct("<HhiiiIii")


class Head(NamedTuple):
    """A packet's header."""

    code: int
    source: int
    size: int
    stamp_at: int
    overflow: int
    capacity: int
    number: int
    valid: int

    @property
    def kind(self) -> int:
        """Type of the events."""
        return self.code & ~COMPRESSED

    @property
    def compressed(self) -> bool:
        """Whether they are compressed."""
        return bool(self.code & COMPRESSED)

    @property
    def length(self) -> int:
        """Bytes after the header."""
        return self.capacity if self.compressed else self.number * self.size

    @property
    def sound(self) -> bool:
        """Whether its numbers are possible for a packet."""
        counts = 0 <= self.valid <= self.number and self.overflow >= 0
        if self.compressed:
            # what is packed takes at least half of its room: no more is allowed for
            counts = counts and self.kind in (POLARITY, FRAME)
            counts = counts and (self.kind != POLARITY or self.number * 4 <= self.capacity)
        else:
            counts = counts and self.number <= self.capacity < 1 << 31
        if self.kind in SIZES:
            return counts and (self.size, self.stamp_at) == SIZES[self.kind]
        least = FRAME_HEAD.size if self.kind == FRAME else 1
        return counts and least <= self.size <= MAX_EVENT_BYTES and self.kind < 128

    def fits(self, at: int, end: int) -> bool:
        """Whether it is valid, and its packet at a byte offset whole."""
        return self.sound and at + NUMBERS.size + self.length <= end

    def packed(self) -> bytes:
        """Its bytes."""
        return NUMBERS.pack(*self)


def read_head(file: BinaryIO, at: int) -> Head | None:
    """The packet's header at a byte offset; None where the file ends before."""
    file.seek(at)
    data = file.read(NUMBERS.size)
    return Head(*NUMBERS.unpack(data)) if len(data) == NUMBERS.size else None
