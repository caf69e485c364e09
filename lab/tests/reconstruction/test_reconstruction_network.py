"""A user's network that makes video: what it receives, what it carries on, what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import TensorProto, helper

from evs.msgs import EVENT_DTYPE, Events, EvsError
from evs_lab.reconstruction import normalised, read_video_network, voxel_grid
from reference.graphs import graph

SHAPE = (6, 10)
TIMES_US = [10_000, 20_000, 30_000]


def leaky(height: Any = "H", width: Any = "W", **given: Any) -> bytes:
    """image = next0 = state0 / 2 + sum of the bins; next1 = the mean of 2 x 2 px, and is not read.

    Args:
        height: The side of the picture, px, or its name.
        width: As height.
        **given: A name of an input or output, and its shape instead.
    """
    inputs = {
        "voxels": (1, 3, height, width),
        "state0": (1, 1, height, width),
        "state1": (1, 1, "H/2", "W/2"),
    }
    outputs = {
        "image": (1, 1, height, width),
        "next0": (1, 1, height, width),
        "next1": (1, 1, "H/2", "W/2"),
    }
    for name, shape in given.items():
        (inputs if name in inputs else outputs)[name] = shape
    return graph(
        [
            helper.make_node("Mul", ["state0", "half"], ["old"]),
            helper.make_node("ReduceSum", ["voxels", "axis"], ["sum"]),
            helper.make_node("Add", ["old", "sum"], ["next0"]),
            helper.make_node("Identity", ["next0"], ["image"]),
            helper.make_node("AveragePool", ["next0"], ["pooled"], kernel_shape=[2, 2],
                             strides=[2, 2]),
            helper.make_node("Add", ["pooled", "state1"], ["next1"]),
        ],
        {"half": np.float32([0.5]), "axis": np.array([1])},
        inputs,
        outputs,
    )  # fmt: skip


def written(folder: Path, model: bytes) -> Path:
    path = folder / "net.onnx"
    path.write_bytes(model)
    return path


def some() -> Events:
    random = np.random.default_rng(3)
    events = np.zeros(500, EVENT_DTYPE)
    # none in the last window, and one at the very end of the first
    events["t"] = np.sort(random.integers(1, 20_001, 500))
    events["t"][events["t"].searchsorted(10_000)] = 10_000
    events["x"], events["y"] = random.integers(0, 10, 500), random.integers(0, 6, 500)
    events["p"] = random.random(500) < 0.5
    return events


@pytest.mark.parametrize("raw", [True, False])
def test_each_picture_is_of_the_events_since_the_last_and_of_the_state(
    tmp_path: Path, raw: bool
) -> None:
    network = read_video_network(written(tmp_path, leaky()), SHAPE, raw=raw, threads=1)
    assert (network.bins, network.padded) == (3, SHAPE)
    assert network.states == ((1, 1, 6, 10), (1, 1, 3, 5))
    events, state, pictures = some(), np.zeros(SHAPE), []
    for end_us in TIMES_US:
        inside = (events["t"] > end_us - 10_000) & (events["t"] <= end_us)
        grid = voxel_grid(events[inside], 3, SHAPE)
        state = state / 2 + (grid if raw else normalised(grid)).sum(axis=0)
        pictures.append(np.clip(state, 0, 1))
    assert network.video(events, TIMES_US) == pytest.approx(np.stack(pictures), abs=1e-5)
    assert np.std(pictures[-1]) > 0.1


def test_sizes_are_padded_to_what_the_states_need(tmp_path: Path) -> None:
    events = some()
    odd = read_video_network(written(tmp_path, leaky()), (7, 11), raw=True)
    assert odd.padded == (8, 12)
    assert odd.states[1] == (1, 1, 4, 6)
    found = odd.video(events, TIMES_US)
    assert found.shape == (3, 7, 11)
    even = read_video_network(written(tmp_path, leaky()), SHAPE, raw=True).video(events, TIMES_US)
    assert found[:, :6, :10] == pytest.approx(even, abs=1e-6)


@pytest.mark.parametrize(
    "shapes",
    [
        # names as torch's exporters write them
        {"height": "2*n", "width": "2*m", "state1": (1, 1, "n", "m"), "next1": (1, 1, "n", "m")},
        {"state1": (1, 1, "H//2", "W//2"), "next1": (1, 1, "H//2", "W//2")},
        {"height": 6, "width": 12, "state1": (1, 1, 3, 6), "next1": (1, 1, 3, 6)},
    ],
)
def test_sides_by_multiples_by_parts_and_by_numbers(tmp_path: Path, shapes: dict[str, Any]) -> None:
    network = read_video_network(written(tmp_path, leaky(**shapes)), (6, 10), raw=True)
    assert network.states[1][:3] == (1, 1, 3)
    plain = read_video_network(written(tmp_path, leaky()), (6, 10), raw=True)
    assert network.video(some(), TIMES_US) == pytest.approx(plain.video(some(), TIMES_US))


BATCH, CHANNELS = (2, 3, "H", "W"), (1, "B", "H", "W")


@pytest.mark.parametrize(
    ("model", "says"),
    [
        (b"no graph", "onnxruntime cannot load the network"),
        (b"", "has 0 bytes; give an ONNX file"),
        (leaky(voxels=BATCH), "must be float32 with four dimensions, the first of them 1"),
        (leaky(voxels=CHANNELS), "'voxels' has B channels; export it with a fixed number"),
        (leaky(height=4, width=4, state1=(1, 1, 2, 2), next1=(1, 1, 2, 2)),
         "'voxels' has 4 x 4 px, too few for a picture of 6 x 10"),
        (leaky(state1=(1, 1, "2*H", "W")), "the side 2*H of a state is no whole part of H"),
        (leaky(state1=(1, 1, "H-1", "W")), "the side 'H-1' cannot be read; call it H, W, H/8"),
        # all is of one size to them
        (leaky(state1=(1, 1, "h", "w"), next1=(1, 1, "h", "w")), "onnxruntime cannot run it"),
        (leaky(state1=(1, 1, 1, 1), next1=(1, 1, "h", "w")), "an output is (1, 1, 3, 5), it must"),
        (graph([helper.make_node("Identity", ["voxels"], ["image"])], {},
               {"voxels": (1, 1, "H", "W"), "state0": (1, 1, "H", "W")},
               {"image": (1, 1, "H", "W")}), "it has 1 states and 1 outputs; give the picture"),
        (graph([helper.make_node("Div", ["voxels", "voxels"], ["image"])], {},
               {"voxels": (1, 1, "H", "W")}, {"image": (1, 1, "H", "W")}),
         "its picture is not finite"),
        (graph([helper.make_node("Identity", ["voxels"], ["image"])], {},
               {"voxels": (1, 1, "H", "W")}, {"image": (1, 1, "H", "W")}, TensorProto.DOUBLE),
         "'voxels' is tensor(double) [1, 1, 'H', 'W']; inputs and outputs must be float32"),
    ],
)  # fmt: skip
def test_a_graph_of_another_form_is_one_line(tmp_path: Path, model: bytes, says: str) -> None:
    with pytest.raises(EvsError) as refused:
        read_video_network(written(tmp_path, model), SHAPE)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match=r"cannot read the network .*none.onnx: No such file"):
        read_video_network(tmp_path / "none.onnx", SHAPE)
