"""The weights in an ONNX file: as much of its wire format as holds them.

An ONNX file is a protocol buffer (ModelProto of onnx.proto). Only ModelProto.graph,
GraphProto.initializer and a few fields of TensorProto are read; all else is skipped. Raises
ValueError with what is wrong, never anything else, whatever the bytes are.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from evs.emulator.base.scene import F32

_GRAPH = 7
_INITIALIZER = 5
_DIMS, _DATA_TYPE, _FLOAT_DATA, _NAME, _RAW_DATA, _EXTERNAL, _LOCATION = 1, 2, 4, 8, 9, 13, 14
_FLOAT = 1
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_MAX_DIMS = 8
_MAX_SIZE = 2**31


def initialisers(model: bytes) -> dict[str, F32]:
    """Every float32 tensor that the graph holds, by name, in its shape; others are left out.

    Raises ValueError: truncated, damaged, weights in another file, no graph.
    """
    graphs = [value for number, value in _fields(memoryview(model)) if number == _GRAPH]
    if not graphs:
        raise ValueError("it holds no ONNX graph")
    found: dict[str, F32] = {}
    for graph in graphs:
        for number, value in _fields(_part(graph)):
            if number == _INITIALIZER:
                name, tensor = _tensor(_part(value))
                if name in found:
                    raise ValueError("two of its initialisers have one name")
                if tensor is not None:
                    found[name] = tensor
    return found


def _tensor(message: memoryview) -> tuple[str, F32 | None]:
    """Name and values of a TensorProto; None: it is not float32."""
    name, kind, dims, raw, floats = "", 0, [], b"", b""
    for number, value in _fields(message):
        if number == _NAME:
            name = bytes(_part(value)).decode("utf-8", "replace")
        elif number == _DATA_TYPE:
            kind = _number(value)
        elif number == _DIMS:  # one by one, or packed
            dims += [value] if isinstance(value, int) else list(_packed(value))
        elif number == _RAW_DATA:
            raw = bytes(_part(value))
        elif number == _FLOAT_DATA:
            floats += bytes(_part(value))
        elif number == _EXTERNAL or (number == _LOCATION and _number(value)):
            raise ValueError("its weights are in another file; save it with the weights inside")
    if kind != _FLOAT:
        return name, None
    data = raw or floats
    count = 1
    for size in dims:
        count *= size  # sizes are not negative: they were read as unsigned
    if len(dims) > _MAX_DIMS or max(dims, default=1) > _MAX_SIZE or len(data) != 4 * count:
        raise ValueError("an initialiser's data is not of its shape")
    values: F32 = np.frombuffer(data, "<f4").astype(np.float32)
    return name, values.reshape(dims)


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """(field number, value) of each field: a number, or the bytes of a message, text or list."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        wire = key & 7
        if wire == _VARINT:
            value, at = _varint(message, at)
            yield key >> 3, value
            continue
        if wire == _BYTES:
            size, at = _varint(message, at)
        elif wire in (_FIXED64, _FIXED32):
            size = 8 if wire == _FIXED64 else 4
        else:
            raise ValueError("it is damaged, or no ONNX file")
        if size > len(message) - at:
            raise ValueError("it is truncated, or no ONNX file")
        yield key >> 3, message[at : at + size]
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """An unsigned number of 7 bits a byte, the lowest first, and where it ends."""
    value = 0
    for i, byte in enumerate(message[at : at + 10]):
        value |= (byte & 0x7F) << (7 * i)
        if byte < 0x80:
            return value, at + i + 1
    raise ValueError("it is truncated, or no ONNX file")


def _packed(values: memoryview) -> Iterator[int]:
    at = 0
    while at < len(values):
        value, at = _varint(values, at)
        yield value


def _part(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise ValueError("it is damaged, or no ONNX file")
    return value


def _number(value: int | memoryview) -> int:
    if not isinstance(value, int):
        raise ValueError("it is damaged, or no ONNX file")
    return value
