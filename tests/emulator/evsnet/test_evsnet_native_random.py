"""Any network, image, light and cut: sparse is dense, every instruction set is the portable one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import EVENTS_PER_TICK
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from reference.networks import random_network

pytestmark = pytest.mark.property


def film(seed: int, ticks: int, height: int, width: int, moving: float) -> F32:
    """Bursts of motion with rests between them, and light that is none."""
    rng = np.random.default_rng(seed)
    frame = np.exp(rng.normal(-2, 2, (height, width)))
    out = np.empty((ticks, height, width), np.float32)
    rests = 0
    for k in range(ticks):
        if rests == 0:
            moves = rng.random(frame.shape) < moving
            frame = np.where(moves, frame * np.exp(rng.normal(0, 0.7, frame.shape)), frame)
            rests = int(rng.choice([0, 0, 0, 1, 30, 80]))
        else:
            rests -= 1
        out[k] = frame
        if rng.random() < 0.1:
            out[k][rng.random(frame.shape) < 0.1] = rng.choice([np.nan, -1.0, np.inf, 0.0, 1e9])
    return out


@pytest.mark.slow
@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    channels=st.integers(1, 9),
    blocks=st.integers(0, 3),
    look_ahead=st.integers(0, 3),
    biased=st.booleans(),
    size=st.tuples(st.integers(1, 9), st.integers(1, 37)),
    moving=st.sampled_from([0.01, 0.1, 0.8]),
    events_per_tick=st.sampled_from(list(EVENTS_PER_TICK)),
    data=st.data(),
)
def test_nothing_that_it_may_choose_shows(
    seed: int,
    channels: int,
    blocks: int,
    look_ahead: int,
    biased: bool,
    size: tuple[int, int],
    moving: float,
    events_per_tick: str,
    data: st.DataObject,
) -> None:
    height, width = size
    weights = random_network(seed, channels, blocks, biased=biased, look_ahead=look_ahead)
    sensor = SensorParameters("test", width, height, 0.15, 0.3)
    light = film(seed, data.draw(st.integers(1, 120)), height, width, moving)
    rule = {"events_per_tick": events_per_tick}
    plain = EvsNetModel(sensor, weights, sparse=False, isa="portable", threads=1, **rule)
    expected, dense = plain.step_chunk(light, plain.init(seed), 0, 1000)

    states = []
    for _ in range(2):
        isa = data.draw(st.sampled_from(_core.isa_available()))
        threads = data.draw(st.integers(1, 3))
        other = EvsNetModel(sensor, weights, isa=isa, threads=threads, **rule)
        state, found = other.init(seed), []
        cuts = sorted(data.draw(st.sets(st.integers(1, len(light)), max_size=5)) - {len(light)})
        for first, last in zip([0, *cuts], [*cuts, len(light)], strict=True):
            state = NetworkState.restore(state.save())
            events, state = other.step_chunk(light[first:last], state, 1000 * first, 1000)
            found += events
        assert [tick.tobytes() for tick in found] == [tick.tobytes() for tick in expected]
        for name in ("v", "last", "last_luminance", "last_log", "tile_moved", "tile_loud"):
            assert state.arrays[name].tobytes() == dense.arrays[name].tobytes(), name
        assert state.clamped == dense.clamped
        assert (state.x_clamped, state.v_clamped) == (dense.x_clamped, dense.v_clamped)
        states.append(state)
    assert states[0] == states[1]
