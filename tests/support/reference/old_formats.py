"""Bytes of formats that evs reads and does not write, made event by event."""

from __future__ import annotations

import struct
from collections.abc import Iterable

AEDAT1_HEAD = b"#!AER-DAT1.0\r\n# a DVS128\r\n"


def aedat1(
    t: Iterable[int],
    x: Iterable[int],
    y: Iterable[int],
    p: Iterable[int],
    head: bytes = AEDAT1_HEAD,
) -> bytes:
    """An AEDAT1 file: x, y from the upper left of a DVS128."""
    addresses = ((127 - y) << 8 | (127 - x) << 1 | 1 - p for x, y, p in zip(x, y, p, strict=True))
    return head + b"".join(
        struct.pack(">Hi", address, stamp) for address, stamp in zip(addresses, t, strict=True)
    )


def event_stream(
    width: int,
    height: int,
    t: Iterable[int],
    x: Iterable[int],
    y: Iterable[int],
    p: Iterable[int],
    exposures: Iterable[bool] | None = None,
) -> bytes:
    """An Event Stream file: x, y from the upper left; with `exposures` an ATIS's, else a DVS's."""
    out = [b"Event Stream\2\0\0", bytes([1 if exposures is None else 2])]
    out.append(struct.pack("<HH", width, height))
    before = 0
    every = list(zip(t, x, y, p, strict=True))
    longest, pause = (127, b"\xff") if exposures is None else (63, b"\xfd")
    kinds = [False] * len(every) if exposures is None else list(exposures)
    for (stamp, column, row, on), exposure in zip(every, kinds, strict=True):
        pauses, passed = divmod(stamp - before, longest)
        before = stamp
        first = passed << 1 | on if exposures is None else passed << 2 | on << 1 | exposure
        out.append(pause * pauses + struct.pack("<BHH", first, column, height - 1 - row))
    return b"".join(out)


def nmnist(t: Iterable[int], x: Iterable[int], y: Iterable[int], p: Iterable[int]) -> bytes:
    """A file of N-MNIST: x, y from the upper left, overflows before what is later than 2^23 us."""
    out, later = [], 0
    for stamp, column, row, on in zip(t, x, y, p, strict=True):
        while stamp - later >= 1 << 23:
            out.append(bytes([0, 240, 0, 0, 0]))
            later += 1 << 13
        out.append(bytes([column, row]) + (on << 23 | stamp - later).to_bytes(3, "big"))
    return b"".join(out)
