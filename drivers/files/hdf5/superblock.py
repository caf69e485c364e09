"""The superblock of an HDF5 file whose recorder was killed: it is marked as being written.

The mark is a byte of it (version 3, "file consistency flags"); it ends with a checksum, Jenkins'
lookup3. Sources: HDF5 File Format Specification 3.0, II.A; burtleburtle.net/bob/c/lookup3.c.
"""

from __future__ import annotations

BYTES = 48

_MAGIC = b"\x89HDF\r\n\x1a\n"
_VERSION_AT, _FLAGS_AT, _END_AT, _SUM_AT = 8, 11, 28, 44
_MASK = 0xFFFFFFFF


def unmarked(head: bytes, size: int) -> bytes | None:
    """Remove the mark from a superblock.

    Args:
        head: The first BYTES bytes of the file.
        size: Size of the file, bytes; what was written last may lie behind the end that the
            superblock states.

    Returns:
        The superblock without the mark; None where there is no mark, or it is damaged.
    """
    sound = head.startswith(_MAGIC) and len(head) == BYTES and head[_VERSION_AT] == 3
    if not sound or not head[_FLAGS_AT]:
        return None
    if lookup3(head[:_SUM_AT]) != int.from_bytes(head[_SUM_AT:], "little"):
        return None
    mended = bytearray(head[:_SUM_AT])
    mended[_FLAGS_AT] = 0
    mended[_END_AT : _END_AT + 8] = size.to_bytes(8, "little")
    return bytes(mended) + lookup3(bytes(mended)).to_bytes(4, "little")


def lookup3(data: bytes) -> int:
    """Jenkins' lookup3 hash of at least one byte, with initial value 0."""
    a = b = c = (0xDEADBEEF + len(data)) & _MASK
    while len(data) > 12:
        a, b, c = _added((a, b, c), data)
        for turn in (4, 6, 8, 16, 19, 4):
            a = ((a - c) ^ _turned(c, turn)) & _MASK
            c = (c + b) & _MASK
            a, b, c = b, c, a
        data = data[12:]
    a, b, c = _added((a, b, c), data.ljust(12, b"\0"))
    for turn in (14, 11, 25, 16, 4, 14, 24):
        c = ((c ^ b) - _turned(b, turn)) & _MASK
        a, b, c = b, c, a
    # after seven turns the one that changed last is here
    return b


def _added(state: tuple[int, int, int], data: bytes) -> tuple[int, int, int]:
    a, b, c = (
        (one + int.from_bytes(data[at : at + 4], "little")) & _MASK
        for one, at in zip(state, (0, 4, 8), strict=True)
    )
    return a, b, c


def _turned(number: int, by: int) -> int:
    return (number << by | number >> 32 - by) & _MASK
