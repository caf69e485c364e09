"""A saved state with anything in it: one clear line, or a state that can be stepped."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.runtime import RUNTIMES
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.networks import random_network

pytestmark = [pytest.mark.property, pytest.mark.slow]

SENSOR = SensorParameters("test", 3, 2, 0.2, 0.2)
MODELS = {
    runtime: EvsNetModel(SENSOR, random_network(1, 2, blocks=1), runtime=runtime, threads=1)
    for runtime in RUNTIMES
}
LIGHT = np.exp(np.random.default_rng(0).normal(0, 1, (4, 2, 3))).astype(np.float32)
SAVED = {}
for _name, _model in MODELS.items():
    _, _state = _model.step_chunk(LIGHT, _model.init(0), 0, 1000)
    SAVED[_name] = _state.save()

KINDS = ["<f4", "<f8", "<i8", "<i4", "<u8", "?", "<c8", "<U4", ">f4", "<f2", "<m8[us]"]
SHAPES = [(), (1,), (2, 3), (3, 2), (2, 3, 1), (0, 3), (1, 6, 6), (2, 6, 6)]


@st.composite
def strange(draw: st.DrawFn) -> np.ndarray[Any, Any]:
    return draw(arrays.arrays(draw(st.sampled_from(KINDS)), draw(st.sampled_from(SHAPES))))


@settings(max_examples=300)
@given(runtime=st.sampled_from(sorted(SAVED)), data=st.data())
def test_anything_instead_of_an_array(runtime: str, data: st.DataObject) -> None:
    saved = dict(SAVED[runtime])
    for _ in range(data.draw(st.integers(1, 2))):
        name = data.draw(st.sampled_from([*sorted(saved), "new"]))
        if data.draw(st.booleans()):
            saved[name] = data.draw(strange())
        else:
            saved.pop(name, None)
    try:
        state = NetworkState.restore(saved)
        events, state = MODELS[runtime].step_chunk(LIGHT, state, 4000, 1000)
    except EvsError as reason:
        said = str(reason)
    else:
        said = ""
        assert len(events) == 4
        assert np.all(np.abs(state.v) <= 64)
    assert "\n" not in said


def test_what_is_whole_is_restored() -> None:
    for runtime, saved in SAVED.items():
        events, _ = MODELS[runtime].step_chunk(LIGHT, NetworkState.restore(saved), 4000, 1000)
        assert len(events) == 4


@pytest.mark.parametrize("runtime", RUNTIMES)
def test_every_bit_of_an_array_may_flip(runtime: str) -> None:
    """Each bit by itself: refused where no stream leads there, and harmless else."""
    saved, refused = SAVED[runtime], set()
    for name, array in saved.items():
        if array.ndim == 0:
            continue
        middle = int(np.argmin(np.abs(np.abs(array) - 1)))  # one bit from NaN or 1e38
        for bit in range(8 * array.itemsize):
            damaged = array.copy()
            flat = damaged.reshape(-1).view(f"<u{array.itemsize}")
            flat[middle] ^= flat.dtype.type(1) << flat.dtype.type(bit)
            state = outcome({**saved, name: damaged}, runtime)
            if state is None:
                refused.add(name)
            else:
                assert np.all(np.isfinite(state.v))
    assert refused >= {"v", "last", "last_log"}


def outcome(saved: dict[str, np.ndarray[Any, Any]], runtime: str) -> NetworkState | None:
    """The state after some ticks more; None: refused."""
    try:
        state = NetworkState.restore(saved)
        _, state = MODELS[runtime].step_chunk(np.tile(LIGHT, (8, 1, 1)), state, 0, 1000)
    except EvsError:
        return None
    return state
