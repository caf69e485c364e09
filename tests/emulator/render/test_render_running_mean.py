"""The noise-adaptive running mean: still, stepping, noisy and impossible light."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from evs.emulator.sensor.running_mean import (
    LARGEST_LIGHT,
    RunningMeanConstants,
    dark,
    running_mean,
    step,
)
from evs.msgs import EvsError

TICKS = 120


def test_still_light_stays_as_it_is() -> None:
    still = np.full((TICKS, 2, 3), 0.3, np.float32)
    np.testing.assert_array_equal(running_mean(still), still)
    np.testing.assert_array_equal(running_mean(0 * still), 0 * still)


def test_noise_shrinks_and_its_mean_stays() -> None:
    rng = np.random.default_rng(0)
    noisy = rng.normal(50, 1, (300, 60, 60)).astype(np.float32)
    mean = running_mean(noisy)
    # a gain g leaves g / (2 - g) of the variance: 1 / 127 at the least gain, and more as b is noisy
    late = mean[150:].var(axis=(1, 2)).mean()
    assert 1 / 127 < late < 1 / 30
    # the mean of 3600 pixels with that variance; 5 deviations
    assert abs(mean[-1].mean() - 50) < 5 * np.sqrt(late / 3600)


def test_the_first_ticks_are_their_plain_mean() -> None:
    rng = np.random.default_rng(3)
    noisy = rng.normal(50, 1, (8, 40, 40)).astype(np.float32)
    calm = running_mean(noisy, RunningMeanConstants(noise_weight=64.0))
    for k in range(8):
        np.testing.assert_allclose(calm[k].mean(), noisy[: k + 1].mean(), rtol=1e-3)
    # that of a few, never the last alone: nearly the variance of a plain mean
    assert calm[7].var() < 1.3 / 8


def test_steps_are_followed_within_ticks_also_through_noise() -> None:
    rng = np.random.default_rng(1)
    for deviation in (0.0, 0.1):
        light = np.ones((TICKS, 40, 40), np.float32)
        light[60:] = 2
        light += rng.normal(0, deviation, light.shape).astype(np.float32)
        mean = running_mean(light).mean(axis=(1, 2))
        assert abs(mean[59] - 1) < 0.01
        assert mean[60] < 1.3
        assert mean[60 + 8] > 1.9
        # a high light has a high gain: the mean leans over by a tenth of the deviation and more
        assert mean.max() < 2.03


def test_the_unit_of_light_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    light = rng.lognormal(0, 1, (TICKS, 8, 8)).astype(np.float32)
    np.testing.assert_array_equal(running_mean(light * 1024), running_mean(light) * 1024)


def test_what_is_no_light_leaves_the_last_and_is_counted() -> None:
    rng = np.random.default_rng(4)
    good = rng.lognormal(0, 1, (40, 1, 5)).astype(np.float32)
    held = good.copy()
    held[20] = good[19]
    bad = good.copy()
    bad[20] = [[np.nan, np.inf, -np.inf, -1, 2 * LARGEST_LIGHT]]
    np.testing.assert_array_equal(running_mean(bad), running_mean(held))

    # nothing yet: no mean; then the first light is it, however late
    state = dark(1, 5)
    for k in range(3):
        mean, state = step(bad[20], state)
        assert np.all(np.isnan(mean))
        assert (state.ticks, state.clamped) == (k + 1, 5 * (k + 1))
    mean, state = step(good[0], state)
    np.testing.assert_array_equal(mean, good[0])
    assert not np.any(state.noise)
    assert not np.any(state.drift)


@pytest.mark.slow
def test_no_denormal_and_no_overflow_is_left() -> None:
    """Whatever the light, and long after it: all state is 0 or a normal number."""
    rng = np.random.default_rng(5)
    size = 4096
    state = dark(1, size)
    least = np.finfo(np.float32).tiny
    for k in range(9000):
        if k < 60:
            light = np.ldexp(rng.random((1, size)), rng.integers(-149, 60, (1, size)))
        elif k == 60:
            light = np.where(rng.random((1, size)) < 0.5, 0, light)
        _, state = step(light.astype(np.float32), state)
        for part in (state.light, state.mean, state.noise, state.drift):
            assert np.all((part == 0) | ((np.abs(part) >= least) & np.isfinite(part)))
    assert state.clamped == 0
    # dark for 9 s: black
    assert not np.any(state.mean[light == 0])


def test_a_step_changes_no_state() -> None:
    rng = np.random.default_rng(6)
    light = rng.lognormal(0, 1, (3, 4, 4)).astype(np.float32)
    _, one = step(light[0], dark(4, 4))
    kept = [part.copy() for part in (one.light, one.mean, one.noise, one.drift)]
    first, _ = step(light[1], one)
    again, _ = step(light[1], one)
    np.testing.assert_array_equal(first, again)
    for part, before in zip((one.light, one.mean, one.noise, one.drift), kept, strict=True):
        np.testing.assert_array_equal(part, before)


@pytest.mark.parametrize("name", [field.name for field in fields(RunningMeanConstants)])
def test_constants_without_sense_are_refused(name: str) -> None:
    for value in (0.0, -1.0, float("nan"), 65.0, "1", True):
        with pytest.raises(EvsError, match=name):
            RunningMeanConstants(**{name: value})  # type: ignore[arg-type]
