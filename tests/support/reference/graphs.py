"""ONNX graphs as other people would bring them, and files of them with a sidecar."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from evs.emulator.evsnet import NetworkWeights
from evs.emulator.evsnet.export import sidecar
from evs.emulator.evsnet.onnx_graph import streaming_graph

Shape = Sequence[int | str]


def renamed(weights: NetworkWeights) -> bytes:
    """The graph of our own network, its weights named as an exporter may name them."""
    model = onnx.load_model_from_string(streaming_graph(weights))
    names = {tensor.name: f"onnx::Conv_{i}" for i, tensor in enumerate(model.graph.initializer)}
    for tensor in model.graph.initializer:
        tensor.name = names[tensor.name]
    for node in model.graph.node:
        inputs = [names.get(name, name) for name in node.input]
        del node.input[:]
        node.input.extend(inputs)
    return bytes(model.SerializeToString())


def graph(
    nodes: list[onnx.NodeProto],
    constants: dict[str, np.ndarray],
    inputs: dict[str, Shape],
    outputs: dict[str, Shape],
    kind: int = TensorProto.FLOAT,
) -> bytes:
    """An ONNX model, not checked."""

    def values(told: dict[str, Shape]) -> list[onnx.ValueInfoProto]:
        return [helper.make_tensor_value_info(name, kind, shape) for name, shape in told.items()]

    tensors = [numpy_helper.from_array(array, name) for name, array in constants.items()]
    made = helper.make_graph(nodes, "theirs", values(inputs), values(outputs), tensors)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    return bytes(model.SerializeToString())


def moving_mean(taps: int = 12, gain: float = 5.0, bias: float = 0.0) -> bytes:
    """current = bias + gain * mean of the last `taps` X: another depth than ours."""
    held = taps - 1
    return graph(
        [
            helper.make_node("Concat", ["state0", "x"], ["read"], axis=2),
            helper.make_node("Slice", ["read", "first", "end", "axis"], ["next0"]),
            helper.make_node("Conv", ["read", "w", "b"], ["current"]),
        ],
        {
            "w": np.full((1, 1, taps, 1), gain / taps, np.float32),
            "b": np.array([bias], np.float32),
            "first": np.array([-held]),
            "end": np.array([2**62]),
            "axis": np.array([2]),
        },
        {"x": (1, 1, "T", "P"), "state0": (1, 1, held, "P")},
        {"current": (1, 1, "T", "P"), "next0": (1, 1, held, "P")},
    )


def recurrent(update: str, amount: float) -> bytes:
    """current = 5 x; the state is changed by `update` (Mul, Add) with `amount` in every call."""
    return graph(
        [
            helper.make_node("Mul", ["x", "gain"], ["current"]),
            helper.make_node(update, ["state0", "amount"], ["next0"]),
        ],
        {"gain": np.float32([5.0]), "amount": np.float32([amount])},
        {"x": (1, 1, "T", "P"), "state0": (1, 2, 1, "P")},
        {"current": (1, 1, "T", "P"), "next0": (1, 2, 1, "P")},
    )


def write(path: Path, model: bytes, weights: NetworkWeights, look_ahead: list[int]) -> Path:
    """NAME.onnx of the model; the sidecar is that of `weights` with another look-ahead."""
    lines = sidecar(weights).splitlines()
    told = [f"look_ahead = {look_ahead}" if "look_ahead" in line else line for line in lines]
    path.write_bytes(model)
    path.with_suffix(".toml").write_text("\n".join(told) + "\n", encoding="utf-8")
    return path
