"""Networks of other people's design: a graph, a sidecar, and runtime onnxruntime."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto, helper

from evs.emulator.evsnet import NetworkWeights
from evs.emulator.evsnet.graph_network import GraphNetwork
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.network_files import read_network
from evs.emulator.evsnet.state import NetworkState, dense_bytes
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.agreement import run
from reference.flickering import HEIGHT, WIDTH, mixed_light
from reference.graphs import graph, moving_mean, recurrent, renamed, write
from reference.networks import random_network

SENSOR = SensorParameters("test", WIDTH, HEIGHT, 0.2, 0.25)
OURS = random_network(5, 4, biased=True, look_ahead=2)
X, STATE = (1, 1, "T", "P"), (1, 2, 6, "P")


def foreign(path: Path, model: bytes, look_ahead: list[int] | None = None) -> GraphNetwork:
    found = read_network(write(path / "theirs.onnx", model, OURS, look_ahead or [2] * 7))
    assert isinstance(found, GraphNetwork)
    return found


def test_our_network_under_other_names_gives_our_bytes(tmp_path: Path) -> None:
    light = mixed_light(60)
    ours = run(EvsNetModel(SENSOR, OURS, runtime="onnxruntime"), light)
    model = EvsNetModel(SENSOR, foreign(tmp_path, renamed(OURS)), runtime="onnxruntime")
    theirs = run(model, light)
    # the FIFOs at rest come from the graph itself, so to rounding only
    assert np.abs(theirs.currents - ours.currents).max() < 1e-5
    assert sum(map(len, ours.events)) == sum(map(len, theirs.events)) > 1_000
    assert model.latency_us == 14_000


def test_what_it_is_stands_in_the_value(tmp_path: Path) -> None:
    network = foreign(tmp_path, renamed(OURS))
    assert (network.name, network.channels, network.latency_ticks) == (OURS.name, 4, 14)
    assert network.tau_s == OURS.tau_s
    assert not network.is_still
    assert [state.shape for state in network.states] == [(1, 6)] + [(4, 6)] * 6
    for state, rest in zip(network.states, OURS.rest(), strict=True):
        np.testing.assert_allclose(state, np.repeat(rest[:, None], 6, axis=1), atol=1e-6)
    # 20 bytes that every network has, 25 channels of 6 ticks
    assert dense_bytes(network, 100, 10) == 1000 * (20 + 4 * 25 * 6)


def test_a_network_of_another_depth_streams(tmp_path: Path) -> None:
    network = foreign(tmp_path, moving_mean(12, 5.0), [3])
    assert network.is_still
    model = EvsNetModel(SENSOR, network, runtime="onnxruntime")
    light = mixed_light(50)
    whole = run(model, light, cut=32)
    assert sum(map(len, whole.events)) > 300
    for cut in (1, 8):
        found = run(model, light, cut=cut)
        assert found.currents.tobytes() == whole.currents.tobytes()
        assert found.state == whole.state
    # the mean of the changes is the change from 12 ticks ago
    log = np.log(255.0 * light[:, 13].astype(np.float64))
    wanted = 5.0 / 12.0 * (log[12:] - log[:-12])
    bright = np.all(255.0 * light[:, 13] > 3.0, axis=0)
    assert bright.any()
    np.testing.assert_allclose(whole.currents[12:, 13][:, bright], wanted[:, bright], atol=1e-5)


def test_a_state_knows_its_graph(tmp_path: Path) -> None:
    first, second = (
        EvsNetModel(SENSOR, foreign(tmp_path, moving_mean(12, gain)), runtime="onnxruntime")
        for gain in (5.0, 4.0)
    )
    light = mixed_light(20)
    _, state = first.step_chunk(light[:9], first.init(1), 0, 1000)
    restored = NetworkState.restore(state.save())
    assert restored == state
    one, _ = first.step_chunk(light[9:], state, 9000, 1000)
    other, _ = first.step_chunk(light[9:], restored, 9000, 1000)
    assert [e.tobytes() for e in one] == [e.tobytes() for e in other]
    with pytest.raises(EvsError, match=r"state is of network .*; call init again"):
        second.step_chunk(light, first.init(1), 0, 1000)


@pytest.mark.parametrize("runtime", ["native", "reference"])
def test_only_onnxruntime_runs_it(tmp_path: Path, runtime: str) -> None:
    network = foreign(tmp_path, moving_mean())
    with pytest.raises(EvsError, match=f"give model.runtime=onnxruntime, not {runtime}$"):
        EvsNetModel(SENSOR, network, runtime=runtime)


def doubled(outputs: dict[str, tuple[int | str, ...]], **inputs: tuple[int | str, ...]) -> bytes:
    """Each output is twice the input in its place."""
    pairs = zip(inputs, outputs, strict=True)
    nodes = [helper.make_node("Add", [name, name], [out]) for name, out in pairs]
    return graph(nodes, {}, dict(inputs), dict(outputs))


BAD = {
    "no x": (
        doubled({"current": X}, light=X),
        r"inputs are \[light\]; a network with 0 states has \[x\]$",
    ),
    "no current": (doubled({"events": X}, x=X), r"outputs are \[events\]; .* has \[current\]$"),
    "a state that does not come back": (
        graph(
            [helper.make_node("Abs", ["x"], ["current"])],
            {},
            {"x": X, "state0": STATE},
            {"current": X},
        ),
        r"outputs are \[current\]; a network with 1 states has \[current, next0\]$",
    ),
    "x of two channels": (
        doubled({"current": (1, 2, "T", "P")}, x=(1, 2, "T", "P")),
        r"x is \[1, 2, T, P\]; it must be \[1, 1, T, P\] with T and P free$",
    ),
    "x of a fixed length": (
        doubled({"current": (1, 1, 16, "P")}, x=(1, 1, 16, "P")),
        r"x is \[1, 1, 16, P\]; it must be \[1, 1, T, P\]",
    ),
    "x of three sides": (
        doubled({"current": (1, "T", "P")}, x=(1, "T", "P")),
        r"x is \[1, T, P\]; it must be",
    ),
    "a state of no known depth": (
        doubled({"current": X, "next0": (1, 2, "D", "P")}, x=X, state0=(1, 2, "D", "P")),
        r"state0 is \[1, 2, D, P\]; it must be \[1, channels, ticks, P\] with P free$",
    ),
    "a state that grows": (
        graph(
            [
                helper.make_node("Abs", ["x"], ["current"]),
                helper.make_node("Concat", ["state0", "x"], ["next0"], axis=2),
            ],
            {},
            {"x": X, "state0": (1, 1, 6, "P")},
            {"current": X, "next0": (1, 1, "D", "P")},
        ),
        r"next0 comes out as float32 \(1, 1, 38, 256\); it must be float32 \(1, 1, 6, 256\)$",
    ),
    "double precision": (
        graph(
            [helper.make_node("Abs", ["x"], ["current"])],
            {},
            {"x": X},
            {"current": X},
            TensorProto.DOUBLE,
        ),
        r"x is tensor\(double\); it must be float32$",
    ),
    "a counter": (recurrent("Add", 1.0), r"is not at rest after 4096 ticks of still light$"),
    "a NaN at rest": (moving_mean(bias=np.nan), r"current holds a NaN or Inf where light stands"),
    "it cannot run": (
        graph(
            [
                helper.make_node("Gather", ["x", "s"], ["one"], axis=3),
                helper.make_node("Add", ["one", "x"], ["current"]),
            ],
            {"s": np.array([300])},
            {"x": X},
            {"current": X},
        ),
        r"onnxruntime cannot run the network: [^\n]+$",
    ),
    "no graph at all": (b"\x3a\x00", r"onnxruntime cannot load the network: [^\n]+$"),
}


@pytest.mark.parametrize(("model", "says"), BAD.values(), ids=BAD.keys())
def test_a_graph_that_is_no_network_is_one_clear_line(
    tmp_path: Path, model: bytes, says: str
) -> None:
    with pytest.raises(EvsError, match=says) as raised:
        foreign(tmp_path, model)
    assert "\n" not in str(raised.value)
    assert "theirs.onnx" in str(raised.value)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("tau_s", 0.0, "tau_s is 0"),
        ("threshold", float("nan"), "threshold is nan"),
        ("linlog_dn", 1.0, "linlog_dn is 1.0"),
        ("tick_us", 0, "tick_us is 0"),
        ("spp", (4, 1), r"spp is \(4, 1\)"),
        ("look_ahead", (-1,), r"look_ahead is \[-1\]"),
        ("look_ahead", (9_999, 2), "10000 in all at most"),
    ],
)
def test_numbers_without_sense_are_refused(
    tmp_path: Path, key: str, value: object, says: str
) -> None:
    network = foreign(tmp_path, moving_mean())
    with pytest.raises(EvsError, match=says):
        dataclasses.replace(network, **{key: value})


def test_a_file_with_our_names_is_ours(tmp_path: Path) -> None:
    from evs.emulator.evsnet.export import export

    path, _ = export(OURS, tmp_path / "ours.onnx", {"seed": 1})
    found = read_network(path)
    assert isinstance(found, NetworkWeights)
    assert found.name == OURS.name
    for one, other in zip(found.convolutions, OURS.convolutions, strict=True):
        np.testing.assert_array_equal(one.weight, other.weight)
        np.testing.assert_array_equal(one.bias, other.bias)
        assert one.look_ahead == other.look_ahead
    assert found.last_bias == np.float32(OURS.last_bias)
