"""What the native network is given that is not right is refused, or does no lasting harm."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import decay_tables
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.networks import random_network

HEIGHT, WIDTH = 5, 9
SENSOR = SensorParameters("test", WIDTH, HEIGHT, 0.2, 0.2)
WEIGHTS = random_network(1, 4, 2)


def film(ticks: int) -> F32:
    rng = np.random.default_rng(0)
    return np.exp(rng.normal(-1, 0.3, (ticks, HEIGHT, WIDTH))).astype(np.float32)


def keywords() -> dict[str, Any]:
    """What a NetworkArray of them is made of."""
    decay = decay_tables(WEIGHTS.tau_s, WEIGHTS.tick_us)
    return {
        "weights": np.concatenate([c.weight.ravel() for c in WEIGHTS.convolutions]),
        "biases": np.zeros((5, 4), np.float32),
        "delays": np.zeros(2, np.int32),
        "last": WEIGHTS.last,
        "last_bias": 0.0,
        "v_on": 1.0,
        "v_off": 1.0,
        "most": 1,
        "decay_low": decay.low,
        "decay_high": decay.high,
        "exposure_dn": 255.0,
        "dark_dn": 0.0,
        "linlog_dn": 2.71828,
    }


def network(
    width: int = WIDTH, height: int = HEIGHT, tick_us: int = 1000, isa: str = "auto", **change: Any
) -> _core.NetworkArray:
    parameters = SimpleNamespace(**{**keywords(), **change})
    return _core.NetworkArray(width, height, parameters, tick_us=tick_us, isa=isa)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"weights": np.zeros(7, np.float32)}, "weights are for another network"),
        ({"biases": np.zeros((5, 3), np.float32)}, "biases must be"),
        ({"biases": np.zeros((4, 4), np.float32)}, "biases must be"),
        ({"delays": np.array([0, 7], np.int32)}, "delays must be"),
        ({"delays": np.array([-1, 0], np.int32)}, "delays must be"),
        ({"delays": np.zeros(9, np.int32)}, "at most 8 blocks"),
        ({"delays": np.zeros(1, np.int32)}, "weights are for another network"),
        ({"last": np.zeros(0, np.float32)}, "1 ... 64 channels"),
        ({"last": np.zeros(65, np.float32)}, "1 ... 64 channels"),
        ({"v_on": 0.0}, "thresholds"),
        ({"v_off": float("nan")}, "thresholds"),
        ({"most": 0}, "1 ... 64 events per tick"),
        ({"most": 65}, "1 ... 64 events per tick"),
        ({"decay_low": np.zeros(255, np.float32)}, "decay tables"),
        ({"decay_high": np.zeros(1, np.float32)}, "decay tables"),
        ({"tick_us": 0}, "tick_us"),
        ({"tick_us": 2**28}, "tick_us"),
        ({"isa": "sse"}, "cannot run instruction set 'sse'"),
    ],
)
def test_a_network_that_does_not_fit_together(change: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        network(**change)


@pytest.mark.parametrize("size", [(0, 4), (-1, 4), (4, -4), (32768, 1)])
def test_sizes_that_are_none(size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="width and height"):
        network(*size)


@pytest.mark.parametrize("wrong", [np.zeros(3, np.float64), np.zeros((2, 2), np.float32), None])
def test_arrays_of_another_kind(wrong: Any) -> None:
    with pytest.raises(TypeError):
        network(last=wrong)


def step(change: dict[str, Any]) -> None:
    model = EvsNetModel(SENSOR, WEIGHTS)
    arrays = {name: array.copy() for name, array in model.init(0).arrays.items()}
    core = network()

    def grow(rows: int) -> F32:
        arrays["fifo"] = np.zeros((rows, core.row_floats), np.float32)
        return arrays["fifo"]

    named = {"luminance": film(5), "tick": 0, "begin_us": 0, "grow": grow, **arrays}
    core.step(**{**named, **change})


@pytest.mark.parametrize(
    ("change", "refused"),
    [
        ({"luminance": film(5)[:, :4].copy()}, ValueError),
        ({"luminance": film(5)[:, :, ::2]}, TypeError),
        ({"luminance": film(5)[0]}, TypeError),
        ({"luminance": film(5).astype(np.float64)}, TypeError),
        ({"luminance": None}, TypeError),
        ({"tick": -1}, ValueError),
        ({"tick": 2**60}, ValueError),
        ({"begin_us": 2**60}, ValueError),
        ({"v": np.zeros((HEIGHT, WIDTH))}, TypeError),
        ({"v": np.zeros((WIDTH, HEIGHT), np.float32)}, ValueError),
        ({"last": np.zeros((HEIGHT, WIDTH), np.int32)}, TypeError),
        ({"last_log": np.zeros((HEIGHT, 8), np.float32)}, ValueError),
        ({"fifo": np.zeros((2, 5), np.float32)}, ValueError),
        ({"tile_row": np.full((2, 2), -1, np.int32)}, ValueError),
        ({"tile_moved": np.zeros((2, 3, 16), np.int32)}, TypeError),
        ({"tile_moved": np.zeros((2, 3), np.int64)}, TypeError),
        ({"tile_moved": np.zeros((2, 3, 15), np.int64)}, ValueError),
        ({"tile_moved": np.zeros((3, 2, 16), np.int64)}, ValueError),
        ({"tile_loud": np.zeros((3, 2), np.uint8)}, ValueError),
        ({"currents": np.zeros((4, HEIGHT, WIDTH), np.float32)}, ValueError),
        ({"grow": lambda rows: np.zeros((rows - 1, 1632), np.float32)}, ValueError),
        ({"grow": lambda rows: np.zeros((rows, 7), np.float32)}, ValueError),
        ({"grow": lambda rows: 1 / 0}, ZeroDivisionError),
        ({"grow": None}, TypeError),
    ],
)
def test_a_step_that_does_not_fit(change: dict[str, Any], refused: type[Exception]) -> None:
    step({})
    with pytest.raises(refused):
        step(change)


def test_memory_of_another_kind_from_grow() -> None:
    with pytest.raises((TypeError, RuntimeError)):
        step({"grow": lambda rows: np.zeros((rows, 1632))})


def test_a_read_only_frame_is_light_as_any() -> None:
    frames = film(5)
    frames.flags.writeable = False
    step({"luminance": frames})


@pytest.mark.parametrize(
    "rows", [[[0, 0, -1], [-1, -1, -1]], [[7, -1, -1], [-1, -1, -1]], [[-2, -1, -1], [-1, -1, -1]]]
)
def test_a_state_whose_rows_are_none(rows: list[list[int]]) -> None:
    model = EvsNetModel(SENSOR, WEIGHTS)
    state = model.init(0)
    state.arrays["fifo"] = np.zeros((2, state.arrays["fifo"].shape[1]), np.float32)
    state.arrays["tile_row"] = np.array(rows, np.int32)
    before = state.copy()
    with pytest.raises(EvsError, match="tile_row is damaged; call init again"):
        model.step_chunk(film(5), state, 0, 1000)
    assert state == before


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("fifo", np.zeros((2, 7), np.float32)),
        ("fifo", np.zeros(4, np.float32)),
        ("tile_row", np.zeros((2, 3), np.int64)),
        ("tile_moved", np.zeros((2, 3), np.int64)),
        ("tile_moved", np.zeros((3, 2, 16), np.int64)),
        ("tile_loud", np.zeros((2, 3), bool)),
    ],
)
def test_a_state_of_another_shape(name: str, array: np.ndarray[Any, Any]) -> None:
    model = EvsNetModel(SENSOR, WEIGHTS)
    state = model.init(0)
    state.arrays[name] = array
    with pytest.raises(EvsError, match=f"{name} is .* call init again"):
        model.step_chunk(film(5), state, 0, 1000)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tile_moved", 2**63 - 1),
        ("tile_moved", -(2**63)),
        ("last", 2**63 - 1),
        ("last", -(2**63)),
        ("v", np.nan),
        ("v", np.inf),
        ("v", -1e30),
        ("tile_loud", 255),
    ],
)
def test_numbers_without_sense_heal(name: str, value: float) -> None:
    """They may cost events; the pixels work again, within bounds."""
    model = EvsNetModel(SENSOR, WEIGHTS)
    _, state = model.step_chunk(film(10), model.init(0), 0, 1000)
    state.arrays[name][:] = value
    events, state = model.step_chunk(film(600), state, 10_000, 1000)
    assert np.all(np.abs(state.v) <= 64)
    assert min(map(len, events[-300:])) >= 0
    assert sum(map(len, events[-300:])) > 100


def test_a_state_that_cannot_be_written_is_copied() -> None:
    model = EvsNetModel(SENSOR, WEIGHTS)
    whole, _ = model.step_chunk(film(10), model.init(0), 0, 1000)
    state = NetworkState.restore(model.init(0).save())
    for array in state.arrays.values():
        array.flags.writeable = False
    found, _ = model.step_chunk(film(10), state, 0, 1000)
    assert [tick.tobytes() for tick in found] == [tick.tobytes() for tick in whole]


def test_memory_that_does_not_suffice_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    model = EvsNetModel(SENSOR, WEIGHTS)
    state, light = model.init(0), film(5)

    def none_left(*_: Any) -> F32:
        raise MemoryError

    monkeypatch.setattr("evs.emulator.evsnet.native.np.zeros", none_left)
    with pytest.raises(EvsError, match="does not fit in memory; use a smaller sensor"):
        model.step_chunk(light, state, 0, 1000)
