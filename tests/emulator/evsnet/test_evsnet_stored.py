"""Networks read back from disk: written by us, by the onnx library, and damaged in every way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.helper
import onnx.numpy_helper
import pytest

from evs.emulator.evsnet import NetworkWeights, network_files
from evs.emulator.evsnet.export import export
from evs.emulator.evsnet.network_files import (
    load_network,
    network_names,
    network_path,
    read_network,
)
from evs.emulator.evsnet.onnx_graph import initialisers
from evs.emulator.evsnet.state import identity
from evs.msgs import EvsError
from reference.networks import random_network

SIDECAR = """name = "mine"
tau_s = 0.4
threshold = 0.2
linlog_dn = 2.718281828459045
tick_us = 1000
spp = [1, 64]
look_ahead = [0, 1, 0, 0, 2, 3, 3]
"""


def tensors_of(weights: NetworkWeights) -> dict[str, np.ndarray[Any, Any]]:
    named = {"encoder": weights.encoder}
    for i, block in enumerate(weights.blocks):
        named |= {f"blocks.{i}.first": block.first, f"blocks.{i}.second": block.second}
    found: dict[str, np.ndarray[Any, Any]] = {}
    for name, convolution in named.items():
        found[f"{name}.weight"] = convolution.weight[..., np.newaxis]
        if convolution.bias is not None:
            found[f"{name}.bias"] = convolution.bias
    found["last.weight"] = weights.last.reshape(1, -1, 1, 1)
    if weights.last_bias:
        found["last.bias"] = np.array([weights.last_bias], np.float32)
    return found


def model_of(initializers: list[onnx.TensorProto]) -> onnx.ModelProto:
    """A graph of one node, with these initialisers."""
    value = onnx.helper.make_tensor_value_info
    node = onnx.helper.make_node("Relu", ["x"], ["current"])
    graph = onnx.helper.make_graph(
        [node],
        "net",
        [value("x", onnx.TensorProto.FLOAT, [1])],
        [value("current", onnx.TensorProto.FLOAT, [1])],
        initializers,
    )
    return onnx.helper.make_model(graph)


def write(
    folder: Path, tensors: dict[str, np.ndarray[Any, Any]], sidecar: str | None = SIDECAR
) -> Path:
    path = folder / "mine.onnx"
    initializers = [onnx.numpy_helper.from_array(array, name) for name, array in tensors.items()]
    path.write_bytes(model_of(initializers).SerializeToString())
    if sidecar is not None:
        path.with_suffix(".toml").write_text(sidecar)
    return path


def refused(path: Path, says: str) -> None:
    """The error is one line that names the file and says this."""
    with pytest.raises(EvsError) as error:
        read_network(path)
    assert says in str(error.value)
    assert path.stem in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "weights",
    [
        random_network(1),
        random_network(2, 4, look_ahead=1),
        random_network(3, biased=True, look_ahead=3),
        random_network(4, 1, blocks=0),
        random_network(5, 12, blocks=2, tau_s=0.123456789),
    ],
    ids=lambda weights: weights.name,
)
def test_what_training_writes_is_read_back(tmp_path: Path, weights: NetworkWeights) -> None:
    path, _ = export(weights, tmp_path / "net.onnx", {"steps": 3, "curve": [1.0, 0.5]})
    found = load_network(str(path))
    # of all that shapes events, and then the rest
    assert identity(found) == identity(weights)
    assert (found.name, found.spp, found.tick_us) == (weights.name, weights.spp, weights.tick_us)
    assert found.latency_ticks == weights.latency_ticks
    for ours, theirs in zip(found.convolutions, weights.convolutions, strict=True):
        assert ours.weight.tobytes() == theirs.weight.tobytes()


@pytest.mark.parametrize("how", ["raw", "floats", "int dims first"])
def test_files_of_the_onnx_library(tmp_path: Path, how: str) -> None:
    weights = random_network(6, 4, biased=True)
    tensors = tensors_of(weights)
    protos = []
    for name, array in tensors.items():
        if how == "raw":
            protos.append(onnx.numpy_helper.from_array(array, name))
        else:
            flat = array.reshape(-1).tolist()
            protos.append(onnx.helper.make_tensor(name, onnx.TensorProto.FLOAT, array.shape, flat))
    if how == "int dims first":
        # what is not float32 is no weight of ours, wherever it stands
        axes = onnx.numpy_helper.from_array(np.array([2, 3], np.int64), "axes")
        half = onnx.numpy_helper.from_array(np.ones((2, 2), np.float16), "half")
        protos = [axes, *protos, half]
    path = tmp_path / "mine.onnx"
    path.write_bytes(model_of(protos).SerializeToString())
    path.with_suffix(".toml").write_text(SIDECAR)
    found = read_network(path)
    assert found.name == "mine"
    assert found.tau_s == 0.4
    assert [c.look_ahead for c in found.convolutions] == [0, 1, 0, 0, 2, 3, 3]
    for name, array in tensors_of(found).items():
        assert array.tobytes() == tensors[name].tobytes(), name
    assert not found.is_still


def test_the_library_reads_the_same_tensors(tmp_path: Path) -> None:
    path, _ = export(random_network(7, biased=True), tmp_path / "net.onnx")
    theirs = {
        proto.name: onnx.numpy_helper.to_array(proto)
        for proto in onnx.load(path).graph.initializer
        if proto.data_type == onnx.TensorProto.FLOAT
    }
    ours = initialisers(path.read_bytes())
    assert ours.keys() == theirs.keys()
    for name, array in theirs.items():
        assert ours[name].tobytes() == array.tobytes()
        assert ours[name].shape == array.shape


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("last.weight", None, "has no float32 initialiser 'last.weight'"),
        ("encoder.weight", None, "has no float32 initialiser 'encoder.weight'"),
        ("blocks.1.second.weight", None, "no float32 initialiser 'blocks.1.second.weight'"),
        ("blocks.0.first.weight", None, "no float32 initialiser 'blocks.0.first.weight'"),
        ("last.weight", np.ones((4,)), "last.weight is (4,); it must be (1, C, 1, 1)"),
        ("last.weight", np.ones((1, 5, 1, 1)), "encoder.weight is (4, 1, 7, 1); it must be (5, 1,"),
        ("encoder.weight", np.ones((4, 1, 5, 1)), "(4, 1, 5, 1); it must be (4, 1, 7, 1)"),
        ("encoder.weight", np.ones((4, 1, 7)), "(4, 1, 7); it must be (4, 1, 7, 1)"),
        ("blocks.2.first.weight", np.ones((4, 4, 1, 7)), "it must be (4, 4, 7, 1)"),
        ("blocks.2.first.bias", np.ones((3,)), "blocks.2.first.bias is (3,); it must be (4,)"),
        ("last.bias", np.ones((2,)), "last.bias is (2,); it must be (1,)"),
        ("encoder.weight", np.full((4, 1, 7, 1), np.nan), "encoder.weight holds a NaN or Inf"),
        ("last.weight", np.full((1, 4, 1, 1), np.inf), "last holds a NaN or Inf"),
        ("last.bias", np.array([np.nan]), "last_bias is nan"),
        ("encoder.weight", np.full((4, 1, 7, 1), 3e38), "a current may exceed 1e+30"),
        ("last.weight", np.ones((1, 0, 1, 1)), "encoder.weight is (4, 1, 7, 1); it must be (0, 1,"),
        ("blocks.3.first.weight", np.ones((4, 4, 7, 1)), "9 convolutions, look_ahead in its"),
        ("blocks.999999.x", np.ones(1), "has 2000001 convolutions, look_ahead in its sidecar 7"),
    ],
)  # fmt: skip
def test_graphs_that_do_not_fit(
    tmp_path: Path, name: str, change: np.ndarray[Any, Any] | None, says: str
) -> None:
    tensors = tensors_of(random_network(6, 4, biased=True))
    if change is None:
        del tensors[name]
    else:
        tensors[name] = change.astype(np.float32)
    refused(write(tmp_path, tensors), says)


def test_weights_of_another_kind(tmp_path: Path) -> None:
    tensors = tensors_of(random_network(6, 4))
    tensors["encoder.weight"] = tensors["encoder.weight"].astype(np.float64)
    refused(write(tmp_path, tensors), "has no float32 initialiser 'encoder.weight'; write it with")


def test_weights_in_another_file(tmp_path: Path) -> None:
    tensors = tensors_of(random_network(6, 64))
    path = write(tmp_path, tensors)
    onnx.save_model(onnx.load(path), path, save_as_external_data=True, location="weights.bin")
    refused(path, "its weights are in another file; save it with the weights inside")


def test_two_of_one_name(tmp_path: Path) -> None:
    proto = onnx.numpy_helper.from_array(np.ones(1, np.float32), "last.bias")
    path = write(tmp_path, tensors_of(random_network(6, 4)))
    path.write_bytes(model_of([proto, proto]).SerializeToString())
    refused(path, "two of its initialisers have one name")


def test_files_that_are_none(tmp_path: Path) -> None:
    path = write(tmp_path, tensors_of(random_network(6, 4, biased=True)))
    whole = path.read_bytes()
    path.write_bytes(b"")
    refused(path, "it holds no ONNX graph")
    path.write_bytes(whole[: len(whole) // 2])
    refused(path, "it is truncated, or no ONNX file")
    path.write_bytes(b"no network at all")
    refused(path, "it is damaged, or no ONNX file")
    path.write_bytes(b"\xff" * 100)
    refused(path, "it is truncated, or no ONNX file")
    with path.open("wb") as file:
        file.truncate(network_files.MAX_BYTES + 1)
    refused(path, "has 67108865 bytes; 67108864 is the most")
    path.unlink()
    refused(path, "no network file")
    path.mkdir()
    refused(path, "no network file")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("", "lacks tau_s; give seconds"),
        ("tau_s = true", "tau_s is True; give seconds"),
        ("tau_s = 'long'", "tau_s is 'long'; give seconds"),
        ("tau_s = nan", "tau_s is nan"),
        ("tau_s = -0.5", "tau_s is -0.5"),
        ("tau_s = inf", "tau_s is inf"),
        ("tau_s = 0.4\ntau = 3", "no key 'tau'; there is tau_s"),
        ("tau_s = 0.4\ntau_s = 0.5", "is not TOML"),
        ("tau_s = ", "is not TOML"),
    ],
)
def test_one_key_of_a_sidecar(tmp_path: Path, line: str, says: str) -> None:
    tensors = tensors_of(random_network(6, 4, biased=True))
    refused(write(tmp_path, tensors, SIDECAR.replace("tau_s = 0.4", line)), says)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('name = "mine"', "", "lacks name; give a line of text"),
        ('name = "mine"', "name = 3", "name is 3; give a line of text"),
        ('name = "mine"', 'name = ""', "name is ''; give a line of text"),
        ('name = "mine"', 'name = "a\\nb"', "name is 'a\\nb'; give a line of text"),
        ("tick_us = 1000", "tick_us = 1000.0", "tick_us is 1000.0; give whole microseconds"),
        ("tick_us = 1000", "tick_us = 0", "tick_us is 0"),
        ("tick_us = 1000", f"tick_us = {10**30}", "give whole microseconds"),
        ("spp = [1, 64]", "spp = 4", "spp is 4; give [fewest, most]"),
        ("spp = [1, 64]", "spp = [1, 4, 9]", "spp is [1, 4, 9]; give [fewest, most]"),
        ("spp = [1, 64]", "spp = [64, 1]", "spp is (64, 1)"),
        ("tick_us = 1000", 'tick_us = 1000\nevents_per_tick = "two"', "give one or many"),
        ("threshold = 0.2", "threshold = 0", "threshold is 0"),
        ("linlog_dn = 2.718281828459045", "linlog_dn = 1", "linlog_dn is 1"),
        ("[0, 1, 0, 0, 2, 3, 3]", "[0, 1, 0]", "has 7 convolutions, look_ahead in its sidecar 3"),
        ("[0, 1, 0, 0, 2, 3, 3]", "[0, 1, 0, 0, 2, 3, 7]", "looks 7 ticks ahead; 0 ... 6"),
        ("[0, 1, 0, 0, 2, 3, 3]", "[0, 1, 0, 0, 2, 3, 4]", "block 2 looks 7 ticks ahead; 6 is"),
        ("[0, 1, 0, 0, 2, 3, 3]", "[0, 0, 0, 0, 0, 0, -1]", "looks -1 ticks ahead"),
        ("[0, 1, 0, 0, 2, 3, 3]", "[0, 0, 0, 0, 0, 0, 1.5]", "give [ticks, one for each"),
        ("tick_us = 1000", "tick_us = 1000\ntraining = 3", "training is 3; give a table"),
        ("tick_us = 1000", "tick_us = 1000\nthresold = 3", "'thresold'; there is threshold"),
    ],
)
def test_sidecars_without_sense(tmp_path: Path, old: str, new: str, says: str) -> None:
    tensors = tensors_of(random_network(6, 4, biased=True))
    assert old in SIDECAR
    refused(write(tmp_path, tensors, SIDECAR.replace(old, new)), says)


def test_sidecars_that_cannot_be_read(tmp_path: Path) -> None:
    path = write(tmp_path, tensors_of(random_network(6, 4)), None)
    refused(path, "mine.onnx has no mine.toml beside it")
    path.with_suffix(".toml").write_bytes(b"name = '\xff'")
    refused(path, "is not TOML")
    path.with_suffix(".toml").write_text("a = " + "[" * 100_000)
    refused(path, "is not TOML")
    path.with_suffix(".toml").unlink()
    path.with_suffix(".toml").mkdir()
    refused(path, "cannot read network sidecar")


def test_networks_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network_files, "_NETWORKS", tmp_path / "networks")
    assert network_names() == []
    with pytest.raises(EvsError, match=r"^no network 'evsnet_c8': there are none$"):
        network_path("evsnet_c8")
    (tmp_path / "networks").mkdir()
    for name in ("evsnet_c8", "paper"):
        export(random_network(1, 4), tmp_path / "networks" / f"{name}.onnx")
    assert network_names() == ["evsnet_c8", "paper"]
    assert network_path("paper") == tmp_path / "networks" / "paper.onnx"
    assert load_network("evsnet_c8").channels == 4
    with pytest.raises(EvsError, match=r"^no network 'evsnet_c6'; there is: evsnet_c8, paper$"):
        network_path("evsnet_c6")
    for path in ("elsewhere/paper", "paper.onnx", "~nobody/paper.onnx", "a/" + "b" * 5000):
        with pytest.raises(EvsError, match=r"^no network file .*; give a \.onnx file or one of: e"):
            network_path(path)


def test_every_network_that_comes_with_evs_can_be_read() -> None:
    for name in network_names():
        weights = load_network(name)
        assert weights.receptive_field == 43
        assert weights.name == name
