"""A stream in chunks of any length, saved and restored between any two, is the same bytes."""

from __future__ import annotations

import io
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import EVENTS_PER_TICK
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.runtime import RUNTIMES
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from reference.networks import random_network

pytestmark = pytest.mark.property

SENSOR = SensorParameters("test", 6, 3, 0.15, 0.2)
NETWORKS = {
    "causal": random_network(1),
    "paper": random_network(4, biased=True, look_ahead=3),
    "one ahead": random_network(6, 4, look_ahead=1),
}
TICKS = 96


def film(seed: int, ticks: int = TICKS) -> F32:
    """Much of it stands still, some of it is no light at all."""
    rng = np.random.default_rng(seed)
    light = np.exp(rng.normal(-2, 1, (3, 6)))
    frames = np.empty((ticks, 3, 6), np.float32)
    for frame in frames:
        if rng.random() < 0.5:
            light = light * np.exp(
                rng.normal(0, 0.5, light.shape) * (rng.random(light.shape) < 0.3)
            )
        frame[:] = light
        if rng.random() < 0.2:
            frame[rng.random(light.shape) < 0.1] = rng.choice([np.nan, -1.0, np.inf, 0.0, 1e9])
    return frames


@cache
def model(name: str, runtime: str, events_per_tick: str = "one") -> EvsNetModel:
    return EvsNetModel(
        SENSOR, NETWORKS[name], runtime=runtime, threads=1, events_per_tick=events_per_tick
    )


def by_ticks(one: EvsNetModel, light: F32, seed: int) -> tuple[list[bytes], NetworkState]:
    state, parts = one.init(seed), []
    for k, frame in enumerate(light):
        events, state = one.step(frame, state, k * 1000, (k + 1) * 1000)
        parts.append(events.tobytes())
    return parts, state


def by_chunks(
    one: EvsNetModel, light: F32, seed: int, cuts: list[int], through_files: bool
) -> tuple[list[bytes], NetworkState]:
    state, parts = one.init(seed), []
    for first, last in zip([0, *cuts], [*cuts, len(light)], strict=True):
        if through_files:
            file = io.BytesIO()
            np.savez(file, **state.save())
            file.seek(0)
            with np.load(file) as saved:
                state = NetworkState.restore(saved)
        events, state = one.step_chunk(light[first:last], state, first * 1000, 1000)
        assert len(events) == last - first
        parts += [tick.tobytes() for tick in events]
    return parts, state


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("chunk", [8, 16, 32, TICKS])
@pytest.mark.parametrize("runtime", RUNTIMES)
def test_chunks_of_the_usual_lengths(name: str, chunk: int, runtime: str) -> None:
    one, light = model(name, runtime), film(11)
    parts, state = by_ticks(one, light, 3)
    assert sum(map(len, parts)) > 16 * 300
    cuts = list(range(chunk, TICKS, chunk))
    assert by_chunks(one, light, 3, cuts, False) == (parts, state)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    name=st.sampled_from(sorted(NETWORKS)),
    runtime=st.sampled_from(list(RUNTIMES)),
    events_per_tick=st.sampled_from(list(EVENTS_PER_TICK)),
    seed=st.integers(0, 2**64 - 1),
    ticks=st.integers(1, 50),
    through_files=st.booleans(),
    data=st.data(),
)
def test_any_cut(
    name: str,
    runtime: str,
    events_per_tick: str,
    seed: int,
    ticks: int,
    through_files: bool,
    data: st.DataObject,
) -> None:
    one, light = model(name, runtime, events_per_tick), film(seed % 2**32, ticks)
    cuts = sorted(data.draw(st.sets(st.integers(1, ticks), max_size=6)) - {ticks})
    whole = by_ticks(one, light, seed)
    assert by_chunks(one, light, seed, cuts, through_files) == whole
