"""What export writes, read_network reads back: every bit of every network."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.evsnet import Block, Convolution, NetworkWeights
from evs.emulator.evsnet.export import export
from evs.emulator.evsnet.network_files import read_network
from evs.emulator.evsnet.state import identity

pytestmark = pytest.mark.property

NAMES = st.text(st.characters(categories=("L", "N", "P", "S")), min_size=1, max_size=20)


@st.composite
def networks(draw: st.DrawFn) -> NetworkWeights:
    channels = draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = draw(st.sampled_from([1e-30, 1e-3, 0.1, 1.0]))

    def convolution(inputs: int, look_ahead: int) -> Convolution:
        weight = (scale * rng.normal(size=(channels, inputs, 7))).astype(np.float32)
        bias = rng.normal(size=channels).astype(np.float32) if draw(st.booleans()) else None
        return Convolution(weight, bias, look_ahead)

    blocks = []
    for _ in range(draw(st.integers(0, 3))):
        first = draw(st.integers(0, 6))
        second = draw(st.integers(0, 6 - first))
        blocks.append(Block(convolution(channels, first), convolution(channels, second)))
    fewest = draw(st.integers(1, 4096))
    return NetworkWeights(
        name=draw(NAMES),
        encoder=convolution(1, draw(st.integers(0, 6))),
        blocks=tuple(blocks),
        last=rng.normal(size=channels).astype(np.float32),
        last_bias=draw(st.sampled_from([0.0, -0.25, 1.5, float(np.float32(0.1))])),
        tau_s=draw(st.floats(1e-3, 10.0)),
        threshold=draw(st.floats(0.01, 2.0)),
        linlog_dn=draw(st.floats(1.1, 100.0)),
        tick_us=draw(st.integers(1, 100_000)),
        spp=(fewest, draw(st.integers(fewest, 4096))),
    )


@settings(max_examples=40, deadline=None)
@given(networks())
def test_a_network_comes_back_bit_for_bit(weights: NetworkWeights) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path, _ = export(weights, Path(folder) / "net.onnx", {"name": weights.name})
        found = read_network(path)
        model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    assert isinstance(found, NetworkWeights)
    assert identity(found) == identity(weights)
    assert (found.name, found.spp, found.tau_s) == (weights.name, weights.spp, weights.tau_s)
    assert found.latency_ticks == weights.latency_ticks
    for one, other in zip(found.convolutions, weights.convolutions, strict=True):
        assert one.look_ahead == other.look_ahead
        assert one.weight.tobytes() == other.weight.tobytes()
        assert (one.bias is None) == (other.bias is None)
        assert one.bias is None or np.array_equal(one.bias, other.bias)
    assert found.last.tobytes() == weights.last.tobytes()
