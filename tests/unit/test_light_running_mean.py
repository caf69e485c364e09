"""The noise-adaptive running mean that studies use: still, stepping and noisy light."""

from __future__ import annotations

import numpy as np

from reference.running_mean import running_mean

TICKS = 120


def test_still_light_stays_as_it_is() -> None:
    still = np.full((TICKS, 2, 3), 0.3, np.float32)
    np.testing.assert_array_equal(running_mean(still), still)
    np.testing.assert_array_equal(running_mean(0 * still), 0 * still)


def test_noise_shrinks_and_its_mean_stays() -> None:
    rng = np.random.default_rng(0)
    noisy = rng.normal(5, 1, (TICKS, 60, 60)).astype(np.float32)
    mean = running_mean(noisy)
    # a gain g leaves g / (2 - g) of the variance: 1 / 63 at the least gain, and more as b is noisy
    late = mean[40:].var(axis=(1, 2)).mean()
    assert 1 / 63 < late < 1 / 15
    # the mean of 3600 pixels with that variance; 5 deviations
    assert abs(mean[-1].mean() - 5) < 5 * np.sqrt(late / 3600)


def test_steps_are_followed_within_ticks_also_through_noise() -> None:
    rng = np.random.default_rng(1)
    for deviation in (0.0, 0.1):
        light = np.ones((TICKS, 40, 40), np.float32)
        light[60:] = 2
        light += rng.normal(0, deviation, light.shape).astype(np.float32)
        mean = running_mean(light).mean(axis=(1, 2))
        assert abs(mean[59] - 1) < 0.01
        assert mean[60] < 1.3
        assert mean[60 + 6] > 1.9
        # a high light has a high gain: the mean leans over by a tenth of the deviation and more
        assert mean.max() < 2.03


def test_the_unit_of_light_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    light = rng.lognormal(0, 1, (TICKS, 8, 8)).astype(np.float32)
    np.testing.assert_array_equal(running_mean(light * 1024), running_mean(light) * 1024)
