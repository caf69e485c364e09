"""Blob: named arrays and a description in one piece of bytes, with a checksum.

    "evs save" | version u32 | crc u32 | head size u32 | head | arrays, one after the other

All little-endian. The crc (CRC-32) is of everything behind it. The head is deflated JSON:
{"about": {...}, "arrays": [[name, dtype, shape, way, stored bytes], ...]}, where way is "raw",
"one" (all items are this one) or "deflate". There is nothing in it that could be run, as in a
pickle.
"""

from __future__ import annotations

import json
import math
import re
import struct
import zlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from evs.msgs import EvsError

Array = np.ndarray[Any, Any]

MAGIC = b"evs save"
VERSION = 1
MAX_BYTES = 2**30
"""Most bytes of arrays in a saved state, as they lie in memory."""

_START = struct.Struct("<8sIII")
_MAX_HEAD = 16 * 2**20
_MAX_DIMENSIONS = 8
_KINDS = re.compile(r"[|<]([iu][1248]|f[48]|U[1-9]\d{0,5})")
_SAMPLES, _SAMPLE_BYTES, _WORTH = 8, 512, 6
_DAMAGED = "saved state is damaged: {}; save it again"


class Row(NamedTuple):
    """The head's entry of an array."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    way: str
    stored: int
    """bytes in the blob"""

    @property
    def ndim(self) -> int:
        """Number of dimensions."""
        return len(self.shape)

    @property
    def nbytes(self) -> int:
        """Bytes in memory."""
        return self.dtype.itemsize * math.prod(self.shape)


Check = Callable[[dict[str, Any], dict[str, Row]], None]
"""Raises EvsError for a description and rows, by name, that do not belong here."""


def pack(about: Mapping[str, Any], arrays: Mapping[str, Array], compress: bool = False) -> bytes:
    """Pack a saved state.

    Args:
        about: Plain values (JSON).
        arrays: Arrays of numbers or text, by name.
        compress: Deflate every array: about 6 times as slow, for half the size. Otherwise only what
            quickly becomes much smaller is deflated.
    """
    rows: list[list[Any]] = []
    parts: list[bytes | memoryview] = []
    for name, array in arrays.items():
        array = np.asarray(array)
        if array.dtype.byteorder == ">":
            array = array.astype(array.dtype.newbyteorder("<"))
        way, stored = _store(np.ascontiguousarray(array), compress)
        rows.append([name, array.dtype.str, list(array.shape), way, len(stored)])
        parts.append(stored)
    head = json.dumps({"about": about, "arrays": rows}, separators=(",", ":"), allow_nan=False)
    packed = zlib.compress(head.encode(), 1)
    crc = zlib.crc32(packed, zlib.crc32(struct.pack("<I", len(packed))))
    for stored in parts:
        crc = zlib.crc32(stored, crc)
    return b"".join([_START.pack(MAGIC, VERSION, crc, len(packed)), packed, *parts])


def unpack(blob: bytes, check: Check | None = None) -> tuple[dict[str, Any], dict[str, Array]]:
    """Unpack a saved state.

    Args:
        blob: What `pack` gave.
        check: Called with description and rows before memory is allocated for any array.

    Returns:
        The description, and the arrays, writable.

    Raises:
        EvsError: It is something else, or damaged.
    """
    raw = _opened(blob)
    _, _, _, size = _START.unpack(raw[: _START.size])
    about, listed = _head(raw[_START.size : _START.size + size])
    place, total = _START.size + size, 0
    rows: dict[str, Row] = {}
    for entry in listed:
        name, row = _checked(entry)
        total += row.nbytes
        place += row.stored
        if total > MAX_BYTES or name in rows or place > len(raw):
            raise EvsError(_DAMAGED.format(f"array {name!r} does not fit in it"))
        rows[name] = row
    if place != len(raw):
        raise EvsError(_DAMAGED.format(f"{len(raw) - place} bytes are left over"))
    if check is not None:
        check(about, rows)
    arrays: dict[str, Array] = {}
    place = _START.size + size
    for name, row in rows.items():
        arrays[name] = _load(raw[place : place + row.stored], row, name)
        if row.dtype.kind == "U" and not _is_text(arrays[name]):
            raise EvsError(_DAMAGED.format(f"array {name!r} holds no text"))
        place += row.stored
    return about, arrays


def described(blob: bytes) -> dict[str, Any]:
    """The description of a saved state, without its arrays. EvsError as in `unpack`."""
    raw = _opened(blob)
    _, _, _, size = _START.unpack(raw[: _START.size])
    return _head(raw[_START.size : _START.size + size])[0]


def _opened(blob: bytes) -> memoryview:
    """The bytes of a saved state, whole and of this format."""
    if not isinstance(blob, bytes | bytearray | memoryview):
        raise EvsError(f"a saved state is bytes, not {type(blob).__name__}: give what save() gave")
    raw = memoryview(blob).cast("B") if memoryview(blob).c_contiguous else memoryview(bytes(blob))
    if len(raw) < _START.size or bytes(raw[: len(MAGIC)]) != MAGIC:
        raise EvsError("these bytes are no saved state of evs: give what save() gave")
    _, version, crc, _ = _START.unpack(raw[: _START.size])
    if version != VERSION:
        raise EvsError(
            f"saved state is of format {version}, this evs reads {VERSION}: save it with this evs"
        )
    if zlib.crc32(raw[_START.size - 4 :]) != crc:
        raise EvsError(_DAMAGED.format(f"its checksum does not fit its {len(raw)} bytes"))
    return raw


def _store(array: Array, compress: bool) -> tuple[str, bytes | memoryview]:
    flat = array.reshape(-1).view(np.uint8) if array.size and array.itemsize else np.zeros(0, "u1")
    raw = flat.data
    if array.size > 1 and bool((flat.reshape(array.size, -1) == flat[: array.itemsize]).all()):
        return "one", bytes(raw[: array.itemsize])
    if len(raw) > _SAMPLES * _SAMPLE_BYTES and (compress or _shrinks(flat)):
        deflated = zlib.compress(raw, 1)
        if len(deflated) < len(raw):
            return "deflate", deflated
    return "raw", raw


def _shrinks(flat: Array) -> bool:
    """Whether samples of the bytes become so small that deflating all of them is quick, too."""
    step = (len(flat) - _SAMPLE_BYTES) // (_SAMPLES - 1)
    sample = b"".join(bytes(flat[i * step : i * step + _SAMPLE_BYTES]) for i in range(_SAMPLES))
    return len(zlib.compress(sample, 1)) * _WORTH < len(sample)


def _load(stored: memoryview, row: Row, name: str) -> Array:
    """An array of its own memory."""
    dtype, shape, size = row.dtype, row.shape, row.nbytes
    if row.way == "deflate":
        inflater = zlib.decompressobj()
        try:
            raw = inflater.decompress(stored, size + 1)
        except zlib.error:
            raw = b""
        if len(raw) != size or not inflater.eof:
            raise EvsError(_DAMAGED.format(f"array {name!r} cannot be inflated"))
        return np.frombuffer(bytearray(raw), dtype).reshape(shape)
    if row.way == "one":
        if len(stored) != dtype.itemsize:
            raise EvsError(_DAMAGED.format(f"array {name!r} has another size"))
        return np.full(shape, np.frombuffer(stored, dtype)[0], dtype)
    if len(stored) != size:
        raise EvsError(_DAMAGED.format(f"array {name!r} has another size"))
    return np.frombuffer(bytearray(stored), dtype).reshape(shape)


def _head(packed: memoryview) -> tuple[dict[str, Any], list[Any]]:
    inflater = zlib.decompressobj()
    try:
        head = json.loads(inflater.decompress(packed, _MAX_HEAD))
        # what JSON escapes need not be text
        json.dumps(head, ensure_ascii=False).encode()
        about, rows = head["about"], head["arrays"]
    except (zlib.error, ValueError, KeyError, TypeError, RecursionError):
        raise EvsError(_DAMAGED.format("its header cannot be read")) from None
    if not isinstance(about, dict) or not isinstance(rows, list):
        raise EvsError(_DAMAGED.format("its header cannot be read"))
    return about, rows


def _checked(entry: Any) -> tuple[str, Row]:
    """An entry of the head: five values, each of its type."""
    five: list[Any] = entry if isinstance(entry, list) and len(entry) == 5 else [None] * 5
    name, kind, shape, way, stored = five
    sound = (
        isinstance(name, str)
        and isinstance(kind, str)
        and _KINDS.fullmatch(kind) is not None
        and isinstance(shape, list)
        and len(shape) <= _MAX_DIMENSIONS
        and all(_is_count(side) for side in shape)
        # without its empty sides, too: numpy multiplies the others
        and math.prod(side or 1 for side in shape) <= MAX_BYTES
        and way in ("raw", "one", "deflate")
        and _is_count(stored)
    )
    if not sound:
        raise EvsError(_DAMAGED.format("its header is invalid"))
    return name, Row(np.dtype(kind), tuple(shape), way, stored)


def _is_text(array: Array) -> bool:
    """Whether its letters are ones that UTF-8 has, and each text one line: messages quote them."""
    letters = array.reshape(-1).view(np.uint32)
    if ((letters > 0x10FFFF) | ((letters >= 0xD800) & (letters < 0xE000))).any():
        return False
    return all(text.splitlines() in ([], [text]) for text in array.flat)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_BYTES
