"""Saved after any tick and restored elsewhere, a sensor goes on with the same bytes."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.base.protocols import EventModel
from evs.emulator.base.scene import F32
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig
from evs.emulator.sensor import PlainState, SensorParameters
from evs.emulator.sensor.pixel import MAX_TICK_US

pytestmark = pytest.mark.property

DAY_US = 86_400_000_000


def off_or(lowest: float, highest: float) -> st.SearchStrategy[float]:
    return st.just(0.0) | st.floats(lowest, highest)


SENSORS = st.builds(
    SensorParameters,
    name=st.just("any"),
    width=st.integers(1, 40),
    height=st.integers(1, 6),
    pos_thres=st.floats(0.05, 0.5),
    neg_thres=st.floats(0.05, 0.5),
    sigma_thres=off_or(0.01, 0.1),
    cutoff_hz=off_or(1.0, 1e4),
    follower_hz=off_or(1.0, 1e4),
    filter=st.sampled_from(["exact", "euler", "large_signal"]),
    highpass_hz=off_or(0.01, 10.0),
    leak_rate_hz=off_or(0.1, 100.0),
    parasitic_leak_hz=off_or(0.1, 100.0),
    shot_noise_rate_hz=off_or(0.1, 1000.0),
    shot_noise_law=st.sampled_from(["linear", "inverse"]),
    noise_rate_cov_decades=off_or(0.1, 0.5),
    refractory_period_s=off_or(1e-6, 0.01),
    hot_leak_median_hz=off_or(0.01, 10.0),
    dead_pixel_fraction=off_or(0.01, 0.5),
    dark_lux=off_or(1e-3, 10.0),
)


def light_of(sensor: SensorParameters, ticks: int, seed: int) -> list[F32]:
    """Much of it stands still for ticks on end, some of it is no light at all."""
    rng = np.random.default_rng(seed)
    shape = (sensor.height, sensor.width)
    light = np.exp(rng.normal(-2, 1, shape))
    frames = []
    for _ in range(ticks):
        if rng.random() < 0.5:
            light = light * np.exp(rng.normal(0, 0.5, shape) * (rng.random(shape) < 0.3))
        frame = light.astype(np.float32)
        if rng.random() < 0.2:
            frame[rng.random(shape) < 0.1] = rng.choice([np.nan, -1.0, np.inf, 0.0])
        frames.append(frame)
    return frames


def advance(
    model: EventModel, state: PlainState, frames: list[F32], ticks_us: list[int], t_us: int
) -> tuple[bytes, PlainState, int]:
    parts = []
    for frame, tick_us in zip(frames, ticks_us, strict=True):
        events, state = model.step(frame, state, t_us, t_us + tick_us)
        parts.append(events.tobytes())
        t_us += tick_us
    return b"".join(parts), state, t_us


@pytest.mark.slow
@settings(max_examples=100)
@given(
    sensor=SENSORS,
    model=st.sampled_from(["plain", "adaptive"]),
    seed=st.integers(0, 2**64 - 1),
    clock_us=st.integers(0, 30 * DAY_US),
    waits=st.integers(0, 3),
    ticks_us=st.lists(
        st.sampled_from([1, 100, 1000]) | st.integers(1, 20_000), min_size=2, max_size=16
    ),
    data=st.data(),
)
def test_resumed_after_any_tick(
    sensor: SensorParameters,
    model: str,
    seed: int,
    clock_us: int,
    waits: int,
    ticks_us: list[int],
    data: st.DataObject,
) -> None:
    config = ModelConfig(name=model)
    frames = light_of(sensor, len(ticks_us), seed % 2**32)
    one = make_event_model(sensor, config, 1)
    state = one.init(seed)
    # the sensor's own clock may be minutes old already
    for _ in range(waits):
        wait_us = MAX_TICK_US if not sensor.shot_noise_rate_hz else 100_000
        _, state = one.step(frames[0], state, clock_us, clock_us + wait_us)
        clock_us += wait_us
    cut = data.draw(st.integers(0, len(ticks_us)))
    kept = state.copy()
    whole, end, _ = advance(one, state, frames, ticks_us, clock_us)

    first, state, t_us = advance(one, kept, frames[:cut], ticks_us[:cut], clock_us)
    file = io.BytesIO()
    np.savez(file, **state.save())
    file.seek(0)
    # another process: nothing but the sensor and the file
    with np.load(file) as saved:
        restored = PlainState.restore(saved)
    assert restored == state
    two = make_event_model(sensor, config, 2)
    second, state, _ = advance(two, restored, frames[cut:], ticks_us[cut:], t_us)
    assert first + second == whole
    assert state == end
