"""The streaming network as an ONNX graph, for onnxruntime and for whoever runs weights elsewhere.

In the layout that onnxruntime runs fastest: time is the height of an image and P pixels its width,
so that a convolution has the kernel (7, 1) and reads its FIFO before the new ticks.

    in    x        float32 [1, 1, T, P]     X of T ticks
          state_i  float32 [1, Cin, 6, P]   what convolution i read in the last 6 ticks
    out   current  float32 [1, 1, T, P]     I, of the light of `latency_ticks` earlier
          next_i   float32 [1, Cin, 6, P]   the state_i of the next call

T and P are free. Before the first tick a state holds NetworkWeights.rest(). Initialisers bear the
names of the fields: encoder.weight [C, 1, 7, 1], blocks.I.first.weight and blocks.I.second.weight
[C, C, 7, 1], last.weight [1, C, 1, 1], and .bias where there is one.

The protobuf wire format is written and read here, so that neither the runtime nor the trainer needs
the onnx library, and the same weights are always the same bytes. Of a file only ModelProto.graph,
GraphProto.initializer and a few fields of TensorProto are read; all else is skipped.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.weights import KERNEL_SIZE, NetworkWeights

OPSET = 17
IR_VERSION = 8
"""the one that came with opset 17"""
HELD = KERNEL_SIZE - 1
"""ticks that a FIFO holds"""

_TICKS_AXIS = 2
_TO_THE_END = 2**63 - 1

# numbers of onnx.proto: TensorProto.DataType and AttributeProto.AttributeType
_FLOAT, _INT64 = 1, 7
_ONE_INT, _INTS = 2, 7


def streaming_graph(weights: NetworkWeights) -> bytes:
    """The ONNX model of these weights: what a file NAME.onnx holds."""
    graph = _Graph()
    hidden = graph.convolution("encoder", "x", weights.encoder.weight, weights.encoder.bias)
    hidden = graph.node("Relu", "encoder.out", [hidden])
    for i, block in enumerate(weights.blocks):
        first, second = f"blocks.{i}.first", f"blocks.{i}.second"
        middle = graph.convolution(first, hidden, block.first.weight, block.first.bias)
        middle = graph.node("Relu", f"{first}.out", [middle])
        change = graph.convolution(second, middle, block.second.weight, block.second.bias)
        # the sum is as late as its branch: h of earlier ticks stands in the FIFO of `first`
        late = graph.delayed(f"{first}.read", hidden, block.look_ahead)
        total = graph.node("Add", f"blocks.{i}.sum", [late, change])
        hidden = graph.node("Relu", f"blocks.{i}.out", [total])
    last = [hidden, graph.constant("last.weight", weights.last.reshape(1, -1, 1, 1))]
    if weights.last_bias != 0.0:
        last.append(graph.constant("last.bias", np.array([weights.last_bias], np.float32)))
    graph.node("Conv", "current", last, kernel_shape=(1, 1))
    return graph.model()


class _Graph:
    """A graph that grows; each method gives the name of what it made."""

    def __init__(self) -> None:
        self._nodes: list[bytes] = []
        self._constants: list[bytes] = []
        self._inputs = [_value("x", 1, "T")]
        self._outputs = [_value("current", 1, "T")]
        self._states = 0

    def node(self, kind: str, out: str, inputs: list[str], **attributes: Any) -> str:
        """NodeProto with one output, whose name it bears itself."""
        fields = [_field(1, name) for name in inputs]
        fields += [_field(2, out), _field(3, out), _field(4, kind)]
        for key, value in attributes.items():
            if isinstance(value, int):
                body = _field(1, key) + _number(3, value) + _number(20, _ONE_INT)
            else:
                ints = b"".join(_number(8, entry) for entry in value)
                body = _field(1, key) + ints + _number(20, _INTS)
            fields.append(_field(5, body))
        self._nodes.append(b"".join(fields))
        return out

    def constant(self, name: str, array: np.ndarray[Any, Any]) -> str:
        """TensorProto, an initialiser: float32 or int64."""
        kind, little = (_INT64, "<i8") if array.dtype == np.int64 else (_FLOAT, "<f4")
        dims = b"".join(_number(1, size) for size in array.shape)
        raw = np.ascontiguousarray(array, little).tobytes()
        self._constants.append(dims + _number(2, kind) + _field(8, name) + _field(9, raw))
        return name

    def convolution(self, name: str, source: str, weight: F32, bias: F32 | None) -> str:
        """What `name` makes of the last 6 ticks and the new ones; adds its state."""
        state, after = f"state{self._states}", f"next{self._states}"
        self._states += 1
        out, channels, taps = weight.shape
        self._inputs.append(_value(state, channels, HELD))
        self._outputs.append(_value(after, channels, HELD))
        read = self.node("Concat", f"{name}.read", [state, source], axis=_TICKS_AXIS)
        self._rows(after, read, -HELD, _TO_THE_END)
        inputs = [read, self.constant(f"{name}.weight", weight.reshape(out, channels, taps, 1))]
        if bias is not None:
            inputs.append(self.constant(f"{name}.bias", bias))
        return self.node("Conv", f"{name}.sum", inputs, kernel_shape=(taps, 1))

    def delayed(self, read: str, source: str, ticks: int) -> str:
        """`source` of `ticks` earlier.

        Args:
            read: The FIFO and the new ticks of it, joined.
            source: Name of the value.
            ticks: How much earlier.
        """
        return self._rows(f"{source}.late", read, HELD - ticks, -ticks) if ticks else source

    def model(self) -> bytes:
        """ModelProto around the GraphProto."""
        body = [_field(1, node) for node in self._nodes]
        body.append(_field(2, "evsnet"))
        body += [_field(5, constant) for constant in self._constants]
        body += [_field(11, value) for value in self._inputs]
        body += [_field(12, value) for value in self._outputs]
        opset = _field(1, "") + _number(2, OPSET)
        fields = [_number(1, IR_VERSION), _field(2, "evs"), _field(7, b"".join(body))]
        return b"".join([*fields, _field(8, opset)])

    def _rows(self, out: str, source: str, first: int, end: int) -> str:
        """Ticks [first, end) of what `source` holds."""
        inputs = [source]
        for key, value in (("first", first), ("end", end), ("axis", _TICKS_AXIS)):
            inputs.append(self.constant(f"{out}.{key}", np.array([value], np.int64)))
        return self.node("Slice", out, inputs)


def _value(name: str, channels: int, ticks: int | str) -> bytes:
    """ValueInfoProto of a float32 [1, channels, ticks, P]."""
    dims = b""
    for size in (1, channels, ticks, "P"):
        dims += _field(1, _field(2, size) if isinstance(size, str) else _number(1, size))
    return _field(1, name) + _field(2, _field(1, _number(1, _FLOAT) + _field(2, dims)))


def _number(field: int, value: int) -> bytes:
    """A field of wire type 0."""
    return _varint(field << 3) + _varint(value % 2**64)


def _field(field: int, content: bytes | str) -> bytes:
    """A field of wire type 2: bytes, a string or a message."""
    raw = content.encode() if isinstance(content, str) else content
    return _varint(field << 3 | 2) + _varint(len(raw)) + raw


def _varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


_GRAPH = 7
_INITIALIZER = 5
_DIMS, _DATA_TYPE, _FLOAT_DATA, _NAME, _RAW_DATA, _EXTERNAL, _LOCATION = 1, 2, 4, 8, 9, 13, 14
_FLOAT32 = 1
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_MAX_DIMS = 8
_MAX_SIZE = 2**31
_MAX_FIELDS = 2**20
"""fields in a file that are read, and single numbers; the largest network of ours has hundreds"""


def initialisers(model: bytes) -> dict[str, F32]:
    """Every float32 tensor that the graph holds, by name, in its shape; others are left out.

    Raises:
        ValueError: Truncated, damaged, weights in another file, no graph. Nothing else is raised,
            whatever the bytes are.
    """
    count = itertools.count()
    graphs = [v for number, v in _read_fields(memoryview(model), count) if number == _GRAPH]
    if not graphs:
        raise ValueError("it holds no ONNX graph")
    found: dict[str, F32] = {}
    for graph in graphs:
        for number, value in _read_fields(_part(graph), count):
            if number == _INITIALIZER:
                name, tensor = _read_tensor(_part(value), count)
                if name in found:
                    raise ValueError("two of its initialisers have one name")
                if tensor is not None:
                    found[name] = tensor
    return found


def _read_tensor(message: memoryview, count: Iterator[int]) -> tuple[str, F32 | None]:
    """Name and values of a TensorProto; None: it is not float32."""
    name, kind, dims, raw, floats = "", 0, [], b"", bytearray()
    for number, value in _read_fields(message, count):
        if number == _NAME:
            name = bytes(_part(value)).decode("utf-8", "replace")
        elif number == _DATA_TYPE:
            kind = _read_number(value)
        elif number == _DIMS:  # one by one, or packed
            dims += [value] if isinstance(value, int) else list(_packed(value, count))
        elif number == _RAW_DATA:
            raw = bytes(_part(value))
        elif number == _FLOAT_DATA:
            floats += bytes(_part(value))
        elif number == _EXTERNAL or (number == _LOCATION and _read_number(value)):
            raise ValueError("its weights are in another file; save it with the weights inside")
    if kind != _FLOAT32:
        return name, None
    data = raw or bytes(floats)
    elements = 1
    for size in dims:
        elements *= size  # sizes are not negative: they were read as unsigned
    if len(dims) > _MAX_DIMS or max(dims, default=1) > _MAX_SIZE or len(data) != 4 * elements:
        raise ValueError("an initialiser's data is not of its shape")
    values: F32 = np.frombuffer(data, "<f4").astype(np.float32)
    return name, values.reshape(dims)


def _bound(count: Iterator[int]) -> None:
    if next(count) >= _MAX_FIELDS:
        raise ValueError(f"it has more than {_MAX_FIELDS} fields: no network is so large")


def _read_fields(
    message: memoryview, count: Iterator[int]
) -> Iterator[tuple[int, int | memoryview]]:
    """(field number, value) of each field: a number, or the bytes of a message, text or list."""
    at = 0
    while at < len(message):
        _bound(count)
        key, at = _read_varint(message, at)
        wire = key & 7
        if key < 8:
            raise ValueError("it is damaged, or no ONNX file")
        if wire == _VARINT:
            value, at = _read_varint(message, at)
            yield key >> 3, value
            continue
        if wire == _BYTES:
            size, at = _read_varint(message, at)
        elif wire in (_FIXED64, _FIXED32):
            size = 8 if wire == _FIXED64 else 4
        else:
            raise ValueError("it is damaged, or no ONNX file")
        if size > len(message) - at:
            raise ValueError("it is truncated, or no ONNX file")
        yield key >> 3, message[at : at + size]
        at += size


def _read_varint(message: memoryview, at: int) -> tuple[int, int]:
    """An unsigned number of 7 bits a byte, the lowest first, and where it ends."""
    value = 0
    for i, byte in enumerate(message[at : at + 10]):
        value |= (byte & 0x7F) << (7 * i)
        if byte < 0x80:
            return value, at + i + 1
    raise ValueError("it is truncated, or no ONNX file")


def _packed(values: memoryview, count: Iterator[int]) -> Iterator[int]:
    at = 0
    while at < len(values):
        _bound(count)
        value, at = _read_varint(values, at)
        yield value


def _part(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise ValueError("it is damaged, or no ONNX file")
    return value


def _read_number(value: int | memoryview) -> int:
    if not isinstance(value, int):
        raise ValueError("it is damaged, or no ONNX file")
    return value
