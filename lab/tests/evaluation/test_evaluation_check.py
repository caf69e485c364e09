"""What is found out about a network that a user brings: what is bad, what worth knowing."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from evs.emulator.evsnet import NetworkWeights
from evs.emulator.evsnet.export import export
from evs.emulator.evsnet.onnx_graph import streaming_graph
from evs.msgs import EvsError
from evs.tools.doctor.check import BAD, NOTE, OK
from evs_lab.evaluation import network_check as check_module
from evs_lab.evaluation.network_check import NetworkReport, check_network
from reference.graphs import Shape, graph, moving_mean, write
from reference.networks import random_network, through_network

X: Shape = (1, 1, "T", "P")
SOUND = through_network(5.0, look_ahead=1)
"""a step of .5 is 2.5 thresholds; late by 7 ticks"""
EVERY = [
    "inputs and outputs",
    "runtimes",
    "graph and named weights",
    "streaming",
    "pixels",
    "X = 0",
    "still after motion",
    "NaN, Inf, negative, 1e9",
    "gain",
    "latency",
    "extreme X",
    "memory of a dense state",
]


@pytest.fixture(autouse=True)
def roomy(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine whose memory does not depend on what else runs."""
    monkeypatch.setattr(check_module, "memory_gb", lambda: (64.0, 32.0))


def checked(tmp_path: Path, weights: NetworkWeights) -> dict[str, tuple[str, str]]:
    path, _ = export(weights, tmp_path / "mine.onnx")
    return told(check_network(path))


def told(check: NetworkReport) -> dict[str, tuple[str, str]]:
    """what -> (verdict, found)"""
    return {finding.what: (finding.verdict, finding.found) for finding in check.findings}


def foreign(tmp_path: Path, model: bytes, look_ahead: int = 5) -> dict[str, tuple[str, str]]:
    return told(check_network(write(tmp_path / "theirs.onnx", model, SOUND, [look_ahead])))


def current(*nodes: onnx.NodeProto, **constants: float) -> bytes:
    """A graph without a state: from x to current."""
    arrays = {name: np.float32([value]) for name, value in constants.items()}
    return graph(list(nodes), arrays, {"x": X}, {"current": X})


def carrying(*nodes: onnx.NodeProto, **constants: float) -> bytes:
    """A graph with one number a pixel as its state."""
    arrays = {name: np.float32([value]) for name, value in constants.items()}
    state: Shape = (1, 1, 1, "P")
    arrays |= {"axis": np.array([2])}
    return graph(list(nodes), arrays, {"x": X, "state0": state}, {"current": X, "next0": state})


def test_a_sound_network_is_sound(tmp_path: Path) -> None:
    path, _ = export(SOUND, tmp_path / "mine.onnx")
    check = check_network(path)
    found = told(check)
    assert list(found) == EVERY
    assert {verdict for verdict, _ in found.values()} == {OK}
    assert check.is_sound
    assert check.name == "through"
    assert "6 of 2 channels x 6 ticks" in found["inputs and outputs"][1]
    assert found["runtimes"][1] == "native, onnxruntime, reference"
    assert found["X = 0"][1] == "the current is exactly 0 for 2000 ticks"
    assert found["still after motion"][1] == "the current is 0 after 7 ticks"
    assert found["gain"][1] == "+2.50 and -2.50 thresholds for a step of +-2.50"
    assert found["latency"][1].endswith("begins after 7, is half done after 7 and over after 7")
    assert "346x260 0.035 GB, 1280x720 0.35 GB, 4096x4096 6.4 GB" in found[EVERY[-1]][1]


def test_it_prints_as_a_table(tmp_path: Path) -> None:
    path, _ = export(SOUND, tmp_path / "mine.onnx")
    lines = check_network(path).markdown().splitlines()
    assert lines[:2] == ["| through | found | |", "|---|---|---|"]
    assert [line.split(" | ")[0][2:] for line in lines[2:]] == EVERY
    assert all(line.count("|") == 4 for line in lines)


def test_the_same_network_is_found_the_same(tmp_path: Path) -> None:
    path, _ = export(random_network(4, 4, biased=True), tmp_path / "mine.onnx")
    assert check_network(path) == check_network(path)


def test_a_biased_network_has_ghosts_as_many_as_counted(tmp_path: Path) -> None:
    # V comes to I / (1 - d) = .02 / .001998 = 10: an event about every 50 ms, ON only
    network = dataclasses.replace(SOUND, last_bias=0.02)
    found = checked(tmp_path, network)
    verdict, said = found["X = 0"]
    assert verdict == NOTE
    assert said.startswith("a current of 0.02: ")
    rate = float(said.split(": ")[1].split()[0])
    # n d^50 - rounding: 1 = .02 (1 - d^n) / (1 - d) gives n = 52.7 ticks, and V(0) is uniform
    assert rate == pytest.approx(1000 / 52.7, rel=0.03)
    assert found["NaN, Inf, negative, 1e9"][0] == NOTE
    assert found["still after motion"][0] == OK


def test_a_network_that_does_not_fire_up_and_down_is_bad(tmp_path: Path) -> None:
    deaf = dataclasses.replace(SOUND, last=np.zeros(2, np.float32))
    found = checked(tmp_path, deaf)
    assert found["gain"][0] == BAD
    assert found["latency"] == (BAD, "no answer to a step of +-0.5")
    one_sided = dataclasses.replace(SOUND, last=np.float32([5.0, 5.0]))
    assert checked(tmp_path, one_sided)["gain"] == (
        BAD,
        "+2.50 and +2.50 thresholds for a step of +-2.50",
    )
    weak = dataclasses.replace(SOUND, last=SOUND.last * np.float32(0.3))
    assert checked(tmp_path, weak)["gain"][0] == NOTE


def test_a_latency_that_cannot_be_is_bad_and_one_that_is_odd_is_told(tmp_path: Path) -> None:
    # its answer ends after 11 ticks
    assert foreign(tmp_path, moving_mean(12), 12)["latency"][0] == BAD
    assert foreign(tmp_path, moving_mean(12), 11)["latency"][0] == OK
    assert foreign(tmp_path, moving_mean(80), 0)["latency"][0] == NOTE


def test_a_graph_of_another_design_is_looked_at_the_same_way(tmp_path: Path) -> None:
    found = foreign(tmp_path, moving_mean())
    assert list(found) == [what for what in EVERY if what != "graph and named weights"]
    assert found.pop("runtimes") == (NOTE, "onnxruntime only: its weights do not have our names")
    assert {verdict for verdict, _ in found.values()} == {OK}


def test_named_weights_in_a_graph_that_computes_something_else_are_bad(tmp_path: Path) -> None:
    weights = random_network(3, 4)
    path, _ = export(weights, tmp_path / "mine.onnx")
    model = onnx.load_model_from_string(streaming_graph(weights))
    # the same graph as another writer lays it out is still ours
    model.producer_name = "another"
    path.write_bytes(model.SerializeToString())
    verdict, said = told(check_network(path))["graph and named weights"]
    assert verdict == OK
    assert said.startswith("currents of the graph and of its named weights differ by 0")
    for node in model.graph.node:
        node.op_type = "Abs" if node.op_type == "Relu" else node.op_type
    path.write_bytes(model.SerializeToString())
    assert told(check_network(path))["graph and named weights"][0] == BAD
    # a graph that is not even for streams
    model.graph.input[0].name = "light"
    path.write_bytes(model.SerializeToString())
    verdict, said = told(check_network(path))["graph and named weights"]
    assert verdict == BAD
    assert said.startswith("weights have our names, but ")


WRONG = {
    "a current that depends on the chunk": (
        current(
            helper.make_node("ReduceMean", ["x"], ["mean"], axes=[2]),
            helper.make_node("Sub", ["x", "mean"], ["less"]),
            helper.make_node("Mul", ["less", "gain"], ["current"]),
            gain=5.0,
        ),
        "streaming",
        "differ from one pass",
    ),
    "a current that depends on the neighbours": (
        current(
            helper.make_node("ReduceMean", ["x"], ["mean"], axes=[3]),
            helper.make_node("Sub", ["x", "mean"], ["less"]),
            helper.make_node("Mul", ["less", "gain"], ["current"]),
            gain=5.0,
        ),
        "pixels",
        "depends on the others",
    ),
    "an overflow": (
        current(
            helper.make_node("Exp", ["x"], ["e"]),
            helper.make_node("Pow", ["e", "five"], ["p"]),
            helper.make_node("Sub", ["p", "one"], ["current"]),
            one=1.0,
            five=5.0,
        ),
        "extreme X",
        "makes a NaN or Inf",
    ),
    "a memory without end": (
        carrying(
            helper.make_node("ReduceSum", ["x", "axis"], ["sum"]),
            helper.make_node("Add", ["state0", "sum"], ["next0"]),
            helper.make_node("Mul", ["x", "gain"], ["now"]),
            helper.make_node("Mul", ["next0", "some"], ["then"]),
            helper.make_node("Add", ["now", "then"], ["current"]),
            gain=5.0,
            some=0.01,
        ),
        "still after motion",
        "from rest after 300 ticks",
    ),
}


@pytest.mark.parametrize(("model", "what", "says"), WRONG.values(), ids=WRONG.keys())
def test_what_a_stream_cannot_do_with_is_bad(
    tmp_path: Path, model: bytes, what: str, says: str
) -> None:
    found = foreign(tmp_path, model, 0)
    assert found[what][0] == BAD
    assert says in found[what][1]


def test_a_network_that_never_falls_silent_is_bad_where_still_light_is_silent(
    tmp_path: Path,
) -> None:
    found = foreign(tmp_path, WRONG["a memory without end"][0], 0)
    assert found["X = 0"][0] == OK
    assert found["NaN, Inf, negative, 1e9"][0] == BAD


def test_what_does_not_fit_into_this_machine_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_module, "memory_gb", lambda: (1.0, 0.1))
    assert checked(tmp_path, SOUND)["memory of a dense state"] == (
        NOTE,
        "346x260 0.035 GB, 1280x720 0.35 GB (not free here), 4096x4096 6.4 GB (not free here)",
    )


def test_bad_files_are_one_clear_line(tmp_path: Path) -> None:
    path, toml = export(SOUND, tmp_path / "mine.onnx")
    whole = path.read_bytes()

    def refused(match: str) -> None:
        with pytest.raises(EvsError, match=match) as raised:
            check_network(path)
        assert "\n" not in str(raised.value)
        assert "mine.onnx" in str(raised.value)

    path.write_bytes(b"")
    refused("holds no ONNX graph")
    path.write_bytes(whole[: len(whole) // 2])
    refused("network file .*")
    model = onnx.load_model_from_string(whole)
    weight = next(t for t in model.graph.initializer if t.name == "blocks.0.first.weight")
    weight.CopyFrom(numpy_helper.from_array(np.full((2, 2, 7, 1), np.nan, np.float32), weight.name))
    path.write_bytes(model.SerializeToString())
    refused(r"blocks\.0\.first\.weight holds a NaN or Inf")
    path.write_bytes(whole)
    toml.unlink()
    refused(r"no mine\.toml beside it")
    path.unlink()
    refused("no network file")


@pytest.mark.slow
def test_damaged_bytes_are_refused_or_found_out_and_never_crash(tmp_path: Path) -> None:
    path, _ = export(random_network(2, 2, 1), tmp_path / "mine.onnx")
    whole = path.read_bytes()
    rng = np.random.default_rng(8)
    refused = 0
    for _ in range(40):
        raw = bytearray(whole)
        for place in rng.integers(0, len(raw), 3):
            raw[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(raw))
        message = refusal(path)
        assert "\n" not in message
        refused += bool(message)
    assert 0 < refused < 40


def refusal(path: Path) -> str:
    """Why it cannot be checked; nothing where it can."""
    try:
        check_network(path)
    except EvsError as reason:
        return str(reason)
    return ""


@pytest.mark.parametrize("network", ["nothing", "nothing.onnx", "./nothing", ""])
def test_a_network_that_is_not_there_is_refused(network: str) -> None:
    with pytest.raises(EvsError, match=r"^no network"):
        check_network(network)


def test_a_provider_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path, _ = export(SOUND, tmp_path / "mine.onnx")
    with pytest.raises(EvsError, match=r"^no execution provider 'gpu'; there is: "):
        check_network(path, provider="gpu")
