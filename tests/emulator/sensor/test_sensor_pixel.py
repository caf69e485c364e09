"""What holds for the plain pixel on any light."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.pixel import log_light
from evs.emulator.sensor.running_mean import RunningMeanConstants
from reference.pixel.model import ReferenceModel, at_clock, caught_up

pytestmark = pytest.mark.property

KNEE = 8.61316967010498
"""Here linlog's linear part is L_log = DN / 4 exactly."""

THRESHOLDS = {
    "name": st.just("any"),
    "width": st.integers(1, 90),
    "height": st.integers(1, 12),
    "pos_thres": st.floats(0.01, 1.0),
    "neg_thres": st.floats(0.01, 1.0),
    "sigma_thres": st.floats(0.0, 0.3),
    "log": st.sampled_from(["linlog", "log_eps", "ln"]),
    "linlog_dn": st.floats(1.01, 100.0),
    "log_eps": st.floats(1e-6, 1.0),
    "exposure_dn": st.floats(0.01, 1e4),
}


def rate(highest_hz: float) -> st.SearchStrategy[float]:
    """Off, or any order of magnitude down to once in 30 years."""
    return st.just(0.0) | st.floats(-9.0, np.log10(highest_hz)).map(lambda x: float(10.0**x))


def with_a_log_of_black(**given: Any) -> SensorParameters:
    """ln has no value without a dark current: there log_eps stands in for it."""
    if given["log"] == "ln" and not given["dark_lux"]:
        given["log"] = "log_eps"
    return SensorParameters(**given)


THRESHOLDS_ONLY = st.builds(
    with_a_log_of_black, **THRESHOLDS, dark_lux=st.just(0.0) | st.floats(1e-11, 40.0)
)
WHOLE_PIXELS = st.builds(
    with_a_log_of_black,
    **THRESHOLDS | {"width": st.integers(1, 35), "height": st.integers(1, 3)},
    white_lux=st.floats(1.0, 1e5),
    dark_lux=st.just(0.0) | st.floats(1e-6, 1e3),
    cutoff_hz=rate(1e7),
    dim_lux=st.just(0.0) | st.floats(0.0, 1e4),
    bright_lux=st.floats(1.0, 1e6),
    filter=st.sampled_from(["exact", "euler", "large_signal"]),
    follower_hz=rate(1e7),
    highpass_hz=rate(1e6),
    temperature_c=st.just(25.0) | st.floats(-40.0, 125.0),
    leak_rate_hz=rate(1e4),
    parasitic_leak_hz=rate(1e4),
    shot_noise_rate_hz=rate(1e4),
    shot_noise_bright=st.floats(0.0, 1.0),
    shot_noise_law=st.sampled_from(["linear", "inverse"]),
    noise_rate_cov_decades=st.just(0.0) | st.floats(0.0, 0.5),
    refractory_period_s=st.just(0.0) | st.floats(1e-6, 0.02),
    hot_leak_median_hz=rate(1e3),
    hot_leak_cov_decades=st.floats(0.0, 3.0),
    dead_pixel_fraction=st.just(0.0) | st.floats(0.0, 0.5),
)
MEANS = st.none() | st.builds(
    RunningMeanConstants,
    noise_gain=st.floats(1e-3, 1.0),
    drift_gain=st.floats(1e-3, 1.0),
    least_gain=st.floats(1e-3, 1.0),
    noise_weight=st.floats(1e-3, 64.0),
)
TICKS_US = st.lists(st.integers(1, 3000), min_size=1, max_size=3)
SPECIAL = np.array([np.nan, np.inf, -np.inf, -1, -0.0, 0, 1e-42, -1e-42, 1e-19, 3e38], np.float32)


def video(sensor: SensorParameters, ticks: int, seed: int, spoilt: float) -> list[F32]:
    """Random light, part of it the same as a tick ago, part of it no light at all."""
    generator = np.random.default_rng(seed)
    shape = (sensor.height, sensor.width)
    light = np.exp(generator.normal(-1, 1, shape)).astype(np.float32)
    frames = [light]
    for _ in range(ticks):
        step = np.exp(generator.normal(0, 0.5, shape)) * (generator.random(shape) < 0.5)
        light = np.where(step > 0, light * step, light).astype(np.float32)
        frame = light.copy()
        bad = generator.random(shape) < spoilt
        frame[bad] = generator.choice(SPECIAL, np.count_nonzero(bad))
        frames.append(frame)
    return frames


def stretches(sensor: SensorParameters, seed: int) -> list[F32]:
    """Light that mostly stands still for some ticks, so that blocks fall asleep and wake up."""
    generator = np.random.default_rng(seed)
    frames = []
    for frame in video(sensor, 3, seed, 0.02):
        frames += [frame] * int(generator.integers(1, 8))
    return frames


@pytest.mark.slow
@settings(max_examples=50, deadline=None)
@given(
    sensor=WHOLE_PIXELS,
    mean=MEANS,
    seed=st.integers(0, 2**64 - 1),
    t_us=st.integers(-(2**62), 2**62),
    clock_us=st.just(0) | st.integers(0, 2**51),
    ticks_us=TICKS_US,
    gap_us=st.integers(0, 10**9),
)
def test_native_gives_the_oracles_bytes(
    sensor: SensorParameters,
    mean: RunningMeanConstants | None,
    seed: int,
    t_us: int,
    clock_us: int,
    ticks_us: list[int],
    gap_us: int,
) -> None:
    """All terms, all instruction sets, some threads; events, their causes and the state."""
    oracle = ReferenceModel(sensor, average=mean, causes=True)
    models = [
        PlainModel(sensor, threads, isa, average=mean, causes=True)
        for threads, isa in enumerate(_core.isa_available(), 1)
    ]
    expected = at_clock(oracle.init(seed), clock_us)
    states = [at_clock(model.init(seed), clock_us) for model in models]
    for k, frame in enumerate(stretches(sensor, seed % 2**32)):
        tick_us = ticks_us[k // 4 % len(ticks_us)]
        events, expected = oracle.step(frame, expected, t_us, t_us + tick_us)
        for i, model in enumerate(models):
            ours, states[i] = model.step(frame, states[i], t_us, t_us + tick_us)
            assert ours.tobytes() == events.tobytes()
            assert caught_up(sensor, states[i]) == expected
        assert all(state == states[0] for state in states)
        t_us += tick_us + (gap_us if k % 5 == 0 else 0)  # light may be missing for a while


@settings(max_examples=60, deadline=None)
@given(sensor=THRESHOLDS_ONLY, seed=st.integers(0, 2**32))
def test_events_add_up_to_the_light_within_one_threshold(
    sensor: SensorParameters, seed: int
) -> None:
    model = PlainModel(sensor, 1)
    state = model.init(seed)
    theta = model.pattern(seed)
    total = np.zeros((sensor.height, sensor.width))
    for k, frame in enumerate(video(sensor, 8, seed, 0.0)):
        events, state = model.step(frame, state, k * 1000, (k + 1) * 1000)
        if k == 0:
            total = state.reference.copy()
        on, y, x = events["p"] == 1, events["y"], events["x"]
        np.add.at(total, (y[on], x[on]), theta.on[y[on], x[on]].astype(np.float64))
        np.subtract.at(total, (y[~on], x[~on]), theta.off[y[~on], x[~on]].astype(np.float64))
        # exactly: no rounding anywhere
        assert np.array_equal(total, state.reference)
        light = log_light(frame, sensor)
        assert np.all(light < total + theta.on)
        assert np.all(light > total - theta.off)
        assert np.all(np.diff(events["t"]) >= 0)
        assert np.all((events["t"] > k * 1000) & (events["t"] <= (k + 1) * 1000))


@settings(max_examples=100, deadline=None)
@given(
    levels=st.lists(st.integers(0, 2048), min_size=2, max_size=12),
    on=st.integers(11, 2048),
    off=st.integers(11, 2048),
    tick_us=st.integers(1, 8000),
)
def test_one_pixel_against_rational_numbers(
    levels: list[int], on: int, off: int, tick_us: int
) -> None:
    """Log light in 1/1024: counts, polarities and stamps exact, told by fractions."""
    sensor = SensorParameters("one", 1, 1, on / 1024, off / 1024, linlog_dn=KNEE, exposure_dn=1.0)
    model = PlainModel(sensor, 1)
    state = model.init(0)
    found = []
    for k, level in enumerate(levels):
        light = np.full((1, 1), level / 256, np.float32)
        events, state = model.step(light, state, (k - 1) * tick_us, k * tick_us)
        found += list(zip(events["t"].tolist(), events["p"].tolist(), strict=True))

    expected, reference = [], levels[0]
    for k in range(1, len(levels)):
        last, now = levels[k - 1], levels[k]
        while reference + on <= now or reference - off >= now:
            reference += on if reference + on <= now else -off
            after = Fraction((reference - last) * tick_us, now - last)
            expected.append(((k - 1) * tick_us + max(1, -(-after // 1)), int(now > last)))
    assert found == expected


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_threads_do_not_matter(seed: int) -> None:
    sensor = SensorParameters("wide", 311, 97, 0.15, 0.2, 0.05)  # several bands, the last one short
    frames = video(sensor, 3, seed, 0.01)
    found = []
    for threads in (1, 2, 3):
        model = PlainModel(sensor, threads)
        state, parts = model.init(seed), []
        for k, frame in enumerate(frames):
            events, state = model.step(frame, state, k * 1000, (k + 1) * 1000)
            parts.append(events.tobytes())
        found.append((b"".join(parts), state))
    assert len(found[0][0]) > 16 * 10_000
    assert found[0] == found[1] == found[2]
