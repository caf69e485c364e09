"""Events back into light: at every instant they tell log light within one threshold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.msgs import EVENT_DTYPE, Events

pytestmark = pytest.mark.property

DAY_US = 86_400_000_000
KNEE = 8.61316967010498
"""Here linlog's linear part is L_log = DN / 4 exactly."""

SENSORS = st.builds(
    SensorParameters,
    name=st.just("ideal"),
    width=st.integers(1, 70),
    height=st.integers(1, 5),
    pos_thres=st.floats(0.05, 1.5),
    neg_thres=st.floats(0.05, 1.5),
    log=st.sampled_from(["linlog", "log_eps"]),
    linlog_dn=st.floats(1.1, 100.0),
    log_eps=st.floats(1e-6, 1.0),
    exposure_dn=st.floats(0.1, 1e4),
)
CLOCKS = st.integers(0, 30 * DAY_US)
TICKS_US = st.lists(st.integers(1, 5000), min_size=1, max_size=12)


def log_of(luminance: F32, sensor: SensorParameters) -> F64:
    """Log light by the map's definition, float64."""
    dn = luminance.astype(np.float64) * sensor.exposure_dn
    if sensor.log == "log_eps":
        return np.asarray(np.log(dn / 255 + sensor.log_eps))
    knee = sensor.linlog_dn
    return np.where(dn >= knee, np.log(np.maximum(dn, knee)), math.log(knee) / knee * dn)


def wander(sensor: SensorParameters, frames: int, seed: int) -> list[F32]:
    """Light over nine decades, black now and then; half of the pixels stay in each tick."""
    rng = np.random.default_rng(seed)
    shape = (sensor.height, sensor.width)
    light = np.exp(rng.normal(-1, 2, shape))
    found = []
    for _ in range(frames):
        found.append(np.where(rng.random(shape) < 0.02, 0, light).astype(np.float32))
        light = np.clip(
            light * np.exp(rng.normal(0, 1, shape) * (rng.random(shape) < 0.5)), 1e-6, 1e3
        )
    return found


@settings(max_examples=100)
@given(sensor=SENSORS, seed=st.integers(0, 2**32), clock_us=CLOCKS, ticks_us=TICKS_US)
def test_events_tell_log_light_within_one_threshold_at_every_instant(
    sensor: SensorParameters, seed: int, clock_us: int, ticks_us: list[int]
) -> None:
    model = PlainModel(sensor, 1)
    state = model.init(seed)
    frames = wander(sensor, len(ticks_us) + 1, seed)
    on, off = (float(np.float32(theta)) for theta in (sensor.pos_thres, sensor.neg_thres))
    _, state = model.step(frames[0], state, clock_us - 1000, clock_us)
    before = log_of(frames[0], sensor)
    told = before.copy()
    rounding = 1e-5  # of float32 log light
    for frame, tick_us in zip(frames[1:], ticks_us, strict=True):
        begin_us, clock_us = clock_us, clock_us + tick_us
        events, state = model.step(frame, state, begin_us, clock_us)
        after = log_of(frame, sensor)
        # between its events a pixel is within its thresholds, one microsecond for the stamp
        for t, x, y, p in events[["t", "x", "y", "p"]].tolist():
            assert begin_us < t <= clock_us
            slope = (after[y, x] - before[y, x]) / tick_us
            light = before[y, x] + slope * (t - begin_us)
            late = abs(slope) + rounding
            assert told[y, x] - off - late <= light <= told[y, x] + on + late
            told[y, x] += on if p else -off
            assert told[y, x] - off - late <= light <= told[y, x] + on + late
        assert np.all(after < told + on + rounding)
        assert np.all(after > told - off - rounding)
        before = after


def mirrored(events: Events) -> bytes:
    """The same events, ON for OFF."""
    other = np.frombuffer(bytearray(events.tobytes()), EVENT_DTYPE)
    other["p"] = 1 - other["p"]
    return other.tobytes()


def stream(sensor: SensorParameters, frames: list[F32], ticks_us: list[int]) -> Events:
    model = PlainModel(sensor, 1)
    state, parts, t_us = model.init(0), [], 0
    for frame, tick_us in zip(frames, ticks_us, strict=True):
        events, state = model.step(frame, state, t_us, t_us + tick_us)
        parts.append(events.tobytes())
        t_us += tick_us
    return np.frombuffer(b"".join(parts), EVENT_DTYPE)


@settings(max_examples=100)
@given(
    on=st.integers(11, 2048),
    off=st.integers(11, 2048),
    seed=st.integers(0, 2**32),
    ticks_us=TICKS_US,
)
def test_mirrored_light_gives_mirrored_events(
    on: int, off: int, seed: int, ticks_us: list[int]
) -> None:
    """Log light in 1/1024, mirrored about 1: nothing rounds, so all but p are the same bytes."""
    sensor = SensorParameters(
        "linear", 40, 3, on / 1024, off / 1024, linlog_dn=KNEE, exposure_dn=1.0
    )
    rng = np.random.default_rng(seed)
    levels = [rng.integers(0, 2049, (3, 40)) for _ in ticks_us]
    frames = [(level / 256).astype(np.float32) for level in levels]
    mirror = [((2048 - level) / 256).astype(np.float32) for level in levels]
    events = stream(sensor, frames, ticks_us)
    swapped = replace(sensor, pos_thres=sensor.neg_thres, neg_thres=sensor.pos_thres)
    assert stream(swapped, mirror, ticks_us).tobytes() == mirrored(events)


@settings(max_examples=60)
@given(theta=st.floats(0.05, 1.0), seed=st.integers(0, 2**32))
def test_the_reciprocal_of_light_gives_mirrored_counts(theta: float, seed: int) -> None:
    """Over the logarithm itself rounding may part the two by an event where light touches a level,
    and never by more."""
    sensor = SensorParameters("log", 64, 8, theta, theta, exposure_dn=255.0)
    rng = np.random.default_rng(seed)
    log = [rng.normal(0, 1, (8, 64))]
    for _ in range(12):
        log.append(log[-1] + rng.normal(0, 0.3, (8, 64)))
    log = [np.clip(level, -3, 3) for level in log]
    found = []
    for sign in (1, -1):
        frames = [np.exp(sign * level).astype(np.float32) for level in log]
        events = stream(sensor, frames, [1000] * len(frames))
        net = np.zeros((8, 64), np.int64)
        np.add.at(net, (events["y"], events["x"]), 2 * events["p"].astype(np.int64) - 1)
        found.append((sign * net, len(events)))
    (net, count), (mirror, mirror_count) = found
    parted = np.abs(net - mirror)
    assert parted.max() <= 1
    # a level within 1e-6 of any of 512 pixels' light in 13 ticks
    assert np.count_nonzero(parted) <= 2
    assert abs(count - mirror_count) <= 4
