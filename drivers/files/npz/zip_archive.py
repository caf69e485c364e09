"""The bytes of a ZIP archive (APPNOTE 6.3, ZIP64) whose members grow, and checksums that follow.

Members are stored, not compressed: then each has its place from the start, and the rest is a few
numbers that can be written again. All dates are ZIP's first day, so that equal content is equal
bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

_VERSION = 45
"""ZIP64"""

_DOS_EPOCH = 0, (0 << 9) | (1 << 5) | 1
"""DOS time and date: 1980-01-01"""

_ZIP64, _ZIP64_H = 0xFFFFFFFF, 0xFFFF
"""32 and 16 bits that mean: see the ZIP64 field"""


@dataclass(frozen=True)
class Member:
    """One file of an archive, stored."""

    name: str
    offset: int
    """of its header in the archive"""
    size: int
    crc: int


def header(member: Member) -> bytes:
    """The header before a member's bytes; its length depends only on the name."""
    name = member.name.encode()
    fixed = struct.pack(
        "<4s5H3I2H",
        b"PK\3\4", _VERSION, 0, 0, *_DOS_EPOCH, member.crc, _ZIP64, _ZIP64, len(name), 20,
    )  # fmt: skip
    return fixed + name + struct.pack("<2H2Q", 1, 16, member.size, member.size)


def directory(members: Iterable[Member], offset: int) -> bytes:
    """The directory at the end of an archive, at `offset`; its length depends only on the names."""
    entries = []
    for member in members:
        name = member.name.encode()
        fixed = struct.pack(
            "<4s6H3I5H2I",
            b"PK\1\2", _VERSION | 3 << 8, _VERSION, 0, 0, *_DOS_EPOCH, member.crc, _ZIP64, _ZIP64,
            len(name), 28, 0, 0, 0, 0o100644 << 16, _ZIP64,
        )  # fmt: skip
        size = member.size
        entries.append(fixed + name + struct.pack("<2H3Q", 1, 24, size, size, member.offset))
    body, count = b"".join(entries), len(entries)
    end = offset + len(body)
    end64 = struct.pack(
        "<4sQ2H2I4Q",
        b"PK\6\6", 44, _VERSION | 3 << 8, _VERSION, 0, 0, count, count, len(body), offset,
    )  # fmt: skip
    locator = struct.pack("<4sIQI", b"PK\6\7", 0, end, 1)
    last = struct.pack(
        "<4s4H2IH", b"PK\5\6", _ZIP64_H, _ZIP64_H, _ZIP64_H, _ZIP64_H, _ZIP64, _ZIP64, 0
    )
    return body + end64 + locator + last


Operator = tuple[int, ...]
"""a linear map of 32-bit checksums: the image of each bit, lowest first"""

_POLYNOMIAL = 0xEDB88320


def zeros(count: int) -> Operator:
    """The effect of `count` zero bytes on a CRC-32 register, by repeated squaring."""
    result: Operator = tuple(1 << bit for bit in range(32))
    power: Operator = (_POLYNOMIAL, *(1 << bit for bit in range(31)))
    bits = 8 * count
    while bits:
        if bits & 1:
            result = compose(power, result)
        power = compose(power, power)
        bits >>= 1
    return result


def compose(second: Operator, first: Operator) -> Operator:
    """The map that applies `first`, then `second`."""
    return tuple(apply(second, image) for image in first)


def apply(operator: Operator, crc: int) -> int:
    """Apply a map to a checksum."""
    out = 0
    for image in operator:
        if crc & 1:
            out ^= image
        crc >>= 1
        if not crc:
            break
    return out


def crc32_combine(crc: int, shift: Operator, crc_behind: int) -> int:
    """CRC-32 of two consecutive pieces; `shift` is zeros(length of the second piece)."""
    return apply(shift, crc) ^ crc_behind
