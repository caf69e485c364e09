"""Changed bytes in a network's files: one clear line, or weights that are sound."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.evsnet import onnx_graph
from evs.emulator.evsnet.export import sidecar
from evs.emulator.evsnet.network_files import read_network
from evs.emulator.evsnet.onnx_graph import initialisers, streaming_graph
from evs.msgs import EvsError
from reference.networks import random_network

pytestmark = pytest.mark.property

WEIGHTS = random_network(1, 2, blocks=1, biased=True, look_ahead=1)
GRAPH = streaming_graph(WEIGHTS)
SIDECAR = sidecar(WEIGHTS, {"steps": 10, "curve": [0.5]}).encode()


T = TypeVar("T")


def outcome(call: Callable[[], T], error: type[Exception]) -> tuple[T | None, str]:
    """What it gives, or what its error says; any other error passes."""
    try:
        return call(), ""
    except error as reason:
        return None, str(reason)


@st.composite
def mutated(draw: st.DrawFn, data: bytes) -> bytes:
    """A few changes: bits, bytes, cuts, insertions, parts that come twice."""
    changed = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(changed) - 1)))
        how = draw(st.sampled_from(["bit", "byte", "cut", "insert", "twice", "delete"]))
        if how == "bit" and changed:
            changed[at] ^= 1 << draw(st.integers(0, 7))
        elif how == "byte":
            changed[at : at + 1] = bytes([draw(st.sampled_from([0, 1, 7, 10, 0x7F, 0x80, 0xFF]))])
        elif how == "cut":
            del changed[at:]
        elif how == "insert":
            changed[at:at] = draw(st.binary(max_size=12))
        else:
            end = at + draw(st.integers(1, 40))
            changed[at:end] = changed[at:end] * 2 if how == "twice" else b""
    return bytes(changed)


@settings(max_examples=400)
@given(data=mutated(GRAPH) | st.binary(max_size=60))
def test_no_graph_breaks_the_reader(data: bytes) -> None:
    tensors, said = outcome(lambda: initialisers(data), ValueError)
    assert "\n" not in said
    if tensors is not None:
        assert sum(array.nbytes for array in tensors.values()) <= len(data)


@settings(max_examples=250)
@given(
    graph=st.just(GRAPH) | mutated(GRAPH),
    toml=st.just(SIDECAR) | mutated(SIDECAR),
)
def test_an_error_of_one_line_or_sound_weights(graph: bytes, toml: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "net.onnx"
        path.write_bytes(graph)
        path.with_suffix(".toml").write_bytes(toml)
        weights, said = outcome(lambda: read_network(path), EvsError)
    if weights is None:
        assert "\n" not in said
        assert folder in said
        return
    assert all(np.all(np.isfinite(rest)) for rest in weights.rest())
    assert weights.receptive_field == 1 + 6 * len(weights.convolutions)
    assert 0.0 < weights.tau_s < float("inf")


def test_every_truncation() -> None:
    """What is cut off is missed: no part of a graph reads as the whole."""
    whole = initialisers(GRAPH)
    for end in range(len(GRAPH)):
        part, _ = outcome(lambda end=end: initialisers(GRAPH[:end]), ValueError)
        # only what came after the graph may be gone
        assert part is None or part.keys() == whole.keys()


def part(field: int, content: bytes) -> bytes:
    """A field of wire type 2 whose length takes three bytes."""
    size = len(content)
    length = bytes([size & 0x7F | 0x80, size >> 7 & 0x7F | 0x80, size >> 14])
    return bytes([field << 3 | 2]) + length + content


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (bytes(50 * 2**20), "it is damaged, or no ONNX file"),
        (b"\x08\x00" * 20_000, "more than 1000 fields"),
        (part(7, b"\x0a\x00" * 20_000), "more than 1000 fields"),
        (part(7, part(5, b"\x25\0\0\0\0" * 20_000)), "more than 1000 fields"),
        (part(7, part(5, part(1, bytes(20_000)))), "more than 1000 fields"),
        (part(7, part(5, part(8, b"n")) * 2000), "more than 1000 fields"),
    ],
    ids=["zeros", "fields", "nodes", "floats one by one", "sizes", "tensors"],
)
def test_megabytes_of_nothing_are_refused_early(
    data: bytes, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(onnx_graph, "_MAX_FIELDS", 1000)
    assert says in outcome(lambda: initialisers(data), ValueError)[1]
