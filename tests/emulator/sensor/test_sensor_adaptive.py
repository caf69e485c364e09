"""The model `adaptive` is `plain` that sees the oracle's running means, byte for byte."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.running_mean import RunningMeanConstants, dark, step

pytestmark = pytest.mark.property

SENSOR = SensorParameters("any", 37, 5, 0.1, 0.12, 0.03)
CONSTANTS = st.just(RunningMeanConstants()) | st.builds(
    RunningMeanConstants,
    noise_gain=st.floats(1e-3, 1.0),
    drift_gain=st.floats(1e-3, 1.0),
    least_gain=st.floats(1e-3, 1.0),
    noise_weight=st.floats(1e-3, 64.0),
)


def noisy(ticks: int, seed: int, spoilt: float, noise: float) -> list[F32]:
    """Light that steps, rests, is noisy, very dim or no light at all."""
    rng = np.random.default_rng(seed)
    shape = (SENSOR.height, SENSOR.width)
    light = np.exp(rng.normal(-2, 3, shape)) * rng.choice([1, 1e-12, 1e-20, 1e12], shape)
    frames = []
    for _ in range(ticks):
        light = light * np.where(rng.random(shape) < 0.05, np.exp(rng.normal(0, 1, shape)), 1)
        frame = light * np.exp(noise * rng.normal(0, 1, shape))
        bad = rng.random(shape) < spoilt
        frame[bad] = rng.choice([np.nan, np.inf, -1, -0.0, 0, 1e-42, 1e-19, 3e18], bad.sum())
        frames.append(frame.astype(np.float32))
    return frames


@pytest.mark.slow
@settings(max_examples=60)
@given(
    constants=CONSTANTS,
    seed=st.integers(0, 2**32),
    spoilt=st.sampled_from([0.0, 0.01, 0.3]),
    noise=st.sampled_from([0.0, 0.01, 0.5]),
    still=st.booleans(),
)
def test_native_means_are_the_oracles(
    constants: RunningMeanConstants, seed: int, spoilt: float, noise: float, still: bool
) -> None:
    frames = noisy(30, seed, spoilt, noise)
    # long after it stands still: blocks of pixels are left out as soon as their means rest
    frames += [frames[-1] if still else np.zeros_like(frames[-1])] * 200
    plain = PlainModel(SENSOR, 1)
    models = [PlainModel(SENSOR, 1, isa, average=constants) for isa in _core.isa_available()]
    state, states = plain.init(1), [model.init(1) for model in models]
    means = dark(SENSOR.height, SENSOR.width)
    for k, frame in enumerate(frames):
        mean, means = step(frame, means, constants)
        expected, state = plain.step(mean, state, k * 1000, k * 1000 + 1000)
        for i, model in enumerate(models):
            events, states[i] = model.step(frame, states[i], k * 1000, k * 1000 + 1000)
            assert events.tobytes() == expected.tobytes()
    for ours in states:
        assert ours.mean is not None
        np.testing.assert_array_equal(ours.mean, means.mean)
        np.testing.assert_array_equal(ours.noise, means.noise)
        np.testing.assert_array_equal(ours.drift, means.drift)
        assert ours.clamped == means.clamped
        assert ours.ticks == means.ticks


def test_it_takes_the_noise_out_of_fresh_samples() -> None:
    """A thirtieth of the events of still light with a tenth of noise, and an edge is still seen."""
    sensor = replace(SENSOR, pos_thres=0.2, neg_thres=0.2, width=40, height=40)
    counts, edges = {}, {}
    for name in ("plain", "adaptive"):
        model = make_event_model(sensor, ModelConfig(name=name), 1)
        state = model.init(0)
        found = []
        rng = np.random.default_rng(7)
        for k in range(300):
            light = np.full((40, 40), 1.0 if k < 250 else 2.0)
            light *= 1 + 0.1 * rng.normal(0, 1, light.shape)
            events, state = model.step(light.astype(np.float32), state, k * 1000, k * 1000 + 1000)
            found.append(events)
        counts[name] = sum(len(events) for events in found[100:250])
        edges[name] = sum(np.count_nonzero(events["p"]) for events in found[250:265])
    assert counts["adaptive"] < counts["plain"] / 30
    # ln 2 is 3.5 thresholds
    assert edges["adaptive"] > 2.5 * 1600
