"""The files that a trained network is kept in: the ONNX graph and its sidecar."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.numpy_helper
import onnx.reference
import onnxruntime
import pytest

from evs.emulator.evsnet import NetworkWeights
from evs.emulator.evsnet.export import export, sidecar
from evs.emulator.evsnet.onnx_graph import streaming_graph
from evs.msgs import EvsError
from reference.networks import random_network

ONE = [(8, 3, False, 0), (4, 3, True, 3), (8, 3, True, 1), (1, 0, False, 2), (5, 1, True, 3)]
"""(channels, blocks, biased, look-ahead of every convolution)"""


def plain_currents(weights: NetworkWeights, x: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """(K, P) currents in float64, from the definition: valid convolutions over a padded series.

    Row k is the current that a stream puts out at tick k, of the light of tick k - latency.
    """
    front = np.zeros((weights.receptive_field - 1, x.shape[1]))
    h = np.concatenate([front, x.astype(np.float64)])[None]

    def convolve(convolution: Any, series: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        windows = np.lib.stride_tricks.sliding_window_view(series, 7, axis=1)
        out = np.einsum("oij,ikpj->okp", convolution.weight.astype(np.float64), windows)
        return out if convolution.bias is None else out + convolution.bias[:, None, None]

    h = np.maximum(convolve(weights.encoder, h), 0.0)
    for block in weights.blocks:
        change = convolve(block.second, np.maximum(convolve(block.first, h), 0.0))
        # valid convolutions take 12 ticks; look-ahead tells how many of them at the end
        late = h[:, 12 - block.look_ahead :][:, : change.shape[1]]
        h = np.maximum(late + change, 0.0)
    out: np.ndarray[Any, Any] = np.einsum("c,ckp->kp", weights.last, h) + weights.last_bias
    return out


def streamed(
    graph: bytes, weights: NetworkWeights, x: np.ndarray[Any, Any], cut: int
) -> np.ndarray[Any, Any]:
    """(K, P) currents of the graph by onnxruntime, `cut` ticks at a time."""
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    pixels = x.shape[1]
    state = [np.tile(rest[None, :, None, None], (1, 1, 6, pixels)) for rest in weights.rest()]
    found = []
    for first in range(0, len(x), cut):
        names = {f"state{i}": array for i, array in enumerate(state)}
        out = session.run(None, {"x": x[None, None, first : first + cut], **names})
        found.append(np.asarray(out[0])[0, 0])
        state = [np.asarray(array) for array in out[1:]]
    return np.concatenate(found)


@pytest.mark.parametrize(("channels", "blocks", "biased", "look_ahead"), ONE)
def test_the_graph_gives_the_currents_of_the_definition(
    channels: int, blocks: int, biased: bool, look_ahead: int
) -> None:
    weights = random_network(3, channels, blocks, biased=biased, look_ahead=look_ahead)
    rng = np.random.default_rng(5)
    x = (rng.normal(0, 0.3, (90, 24)) * (rng.random((90, 24)) < 0.4)).astype(np.float32)
    wanted = plain_currents(weights, x)
    assert wanted.std() > 0.01
    for cut in (1, 7, 90):
        found = streamed(streaming_graph(weights), weights, x, cut)
        assert np.max(np.abs(found - wanted)) < 1e-5


@pytest.mark.parametrize(("channels", "blocks", "biased", "look_ahead"), ONE)
def test_another_reader_finds_a_sound_model_and_the_same_numbers(
    channels: int, blocks: int, biased: bool, look_ahead: int
) -> None:
    weights = random_network(4, channels, blocks, biased=biased, look_ahead=look_ahead)
    model = onnx.load_model_from_string(streaming_graph(weights))
    onnx.checker.check_model(model, full_check=True)
    assert (model.ir_version, [o.version for o in model.opset_import]) == (8, [17])
    found = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    wanted = {"encoder.weight": weights.encoder.weight[..., None]}
    named = {"encoder": weights.encoder}
    for i, block in enumerate(weights.blocks):
        named |= {f"blocks.{i}.first": block.first, f"blocks.{i}.second": block.second}
    for name, convolution in named.items():
        wanted[f"{name}.weight"] = convolution.weight[..., None]
        if convolution.bias is not None:
            wanted[f"{name}.bias"] = convolution.bias
    wanted["last.weight"] = weights.last[None, :, None, None]
    if biased:
        wanted["last.bias"] = np.array([weights.last_bias], np.float32)
    floats = {name: array for name, array in found.items() if array.dtype == np.float32}
    assert sorted(floats) == sorted(wanted)
    for name, array in wanted.items():
        np.testing.assert_array_equal(floats[name], array)


def test_inputs_and_outputs_are_as_the_page_says() -> None:
    model = onnx.load_model_from_string(streaming_graph(random_network(1, 4, 2)))

    def shapes(values: Any) -> dict[str, list[Any]]:
        return {
            value.name: [d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]
            for value in values
        }

    inputs, outputs = shapes(model.graph.input), shapes(model.graph.output)
    assert list(inputs) == ["x", "state0", "state1", "state2", "state3", "state4"]
    assert list(outputs) == ["current", "next0", "next1", "next2", "next3", "next4"]
    assert inputs["x"] == outputs["current"] == [1, 1, "T", "P"]
    assert inputs["state0"] == outputs["next0"] == [1, 1, 6, "P"]
    assert inputs["state4"] == outputs["next4"] == [1, 4, 6, "P"]
    types = {v.type.tensor_type.elem_type for v in [*model.graph.input, *model.graph.output]}
    assert types == {onnx.TensorProto.FLOAT}


def test_the_sidecar_reads_back_as_what_was_said(tmp_path: Path) -> None:
    weights = dataclasses.replace(
        random_network(2, 4, look_ahead=1),
        name='a "b" \\ é',
        tau_s=0.1 + 0.2,
        spp=(4, 16),
        events_per_tick="many",
    )
    training = {
        "seed": np.int64(7),
        "steps": 20_000,
        "loss": np.float32(0.25),
        "done": True,
        "held out": ["humanoid", "a\nb"],
        "curve": {"emd": [3.5, 1e-7], "deeper": {"of": "it"}},
    }
    graph, toml = export(weights, tmp_path / "mine.onnx", training)
    assert (graph, toml) == (tmp_path / "mine.onnx", tmp_path / "mine.toml")
    assert graph.read_bytes() == streaming_graph(weights)
    assert tomllib.loads(toml.read_text("utf-8")) == {
        "name": 'a "b" \\ é',
        "tau_s": 0.1 + 0.2,
        "threshold": 0.2,
        "linlog_dn": 2.718281828459045,
        "events_per_tick": "many",
        "tick_us": 1000,
        "spp": [4, 16],
        "look_ahead": [1] * 7,
        "training": training,
    }


def test_the_same_network_is_the_same_files(tmp_path: Path) -> None:
    paths = [export(random_network(2), tmp_path / f"{n}.onnx", {"seed": 1}) for n in "ab"]
    assert paths[0][0].read_bytes() == paths[1][0].read_bytes()
    assert paths[0][1].read_bytes() == paths[1][1].read_bytes()
    assert streaming_graph(random_network(3)) != streaming_graph(random_network(2))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), None, b"x", 2**64, {1}, object()])
def test_what_toml_does_not_know_is_refused(value: Any) -> None:
    with pytest.raises(EvsError, match=r"^cannot write training\.a\.b = .*finite numbers"):
        sidecar(random_network(2), {"a": {"b": value}})


def test_a_network_goes_to_a_file_that_ends_in_onnx_and_whose_folder_is_there(
    tmp_path: Path,
) -> None:
    with pytest.raises(EvsError, match=r"must end in \.onnx"):
        export(random_network(2), tmp_path / "mine.toml")
    with pytest.raises(EvsError, match="No such file or directory"):
        export(random_network(2), tmp_path / "none" / "mine.onnx")
    assert list(tmp_path.iterdir()) == []


def test_where_one_of_the_two_cannot_be_written_neither_is(tmp_path: Path) -> None:
    kept = export(random_network(2), tmp_path / "mine.onnx")[0].read_bytes()
    (tmp_path / "mine.toml.part").mkdir()
    with pytest.raises(EvsError, match="Is a directory"):
        export(random_network(3), tmp_path / "mine.onnx")
    assert (tmp_path / "mine.onnx").read_bytes() == kept
    assert not (tmp_path / "mine.onnx.part").exists()
