"""The fixed pattern of thresholds, and the spread of stamps inside a tick."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.fixed_pattern import FLOOR, draw_pattern
from evs.emulator.sensor.random import Term, pixel_normals

pytestmark = pytest.mark.statistical

WIDTH, HEIGHT = 346, 260
COUNT = WIDTH * HEIGHT
Z = 4.5
"""Bounds lie at 4.5 standard errors: a right program fails one such test in 150,000 new seeds."""


def sensor(sigma: float, width: int = WIDTH, height: int = HEIGHT) -> SensorParameters:
    return SensorParameters("test", width, height, 0.3, 0.2, sigma)


def normals(seed: int, term: Term) -> np.ndarray:
    return pixel_normals(seed, term, WIDTH, HEIGHT)


@pytest.mark.parametrize("seed", [0, 1, 2**63, -1])
def test_normals_have_the_moments_of_a_normal_distribution(seed: int) -> None:
    for term in Term:
        n = normals(seed, term).ravel()
        assert abs(n.mean()) < Z / math.sqrt(COUNT)
        assert abs(n.var() - 1) < Z * math.sqrt(2 / COUNT)
        assert abs((n**3).mean()) < Z * math.sqrt(15 / COUNT)
        assert abs((n**4).mean() - 3) < Z * math.sqrt(96 / COUNT)


def test_normals_have_the_distribution_function_of_a_normal_distribution() -> None:
    ordered = np.sort(normals(7, Term.THRESHOLD_ON).ravel())
    expected = np.array([0.5 * math.erfc(-value / math.sqrt(2)) for value in ordered])
    # Kolmogorov and Smirnov; 2.3 / sqrt(n) has a probability of 5e-5
    assert np.max(np.abs(np.arange(1, COUNT + 1) / COUNT - expected)) < 2.3 / math.sqrt(COUNT)
    assert 3.5 < ordered[-1] < 6.5
    assert -6.5 < ordered[0] < -3.5


def test_polarities_seeds_and_neighbours_are_independent() -> None:
    on, off = normals(3, Term.THRESHOLD_ON), normals(3, Term.THRESHOLD_OFF)
    pairs = [
        (on, off),
        (on, normals(4, Term.THRESHOLD_ON)),
        (on, normals(4, Term.THRESHOLD_OFF)),
        (on[:, 1:], on[:, :-1]),
        (on[1:], on[:-1]),
        (on[1:, 1:], on[:-1, :-1]),
    ]
    for a, b in pairs:
        assert abs((a * b).mean()) < Z / math.sqrt(a.size)
        assert abs((a**2 * b**2).mean() - 1) < Z * math.sqrt(8 / a.size)


@pytest.mark.parametrize("sigma", [0.01, 0.03])
def test_thresholds_have_the_configured_mean_and_sigma(sigma: float) -> None:
    theta = draw_pattern(sensor(sigma), 11)
    for values, mean in ((theta.on, 0.3), (theta.off, 0.2)):
        values = values.astype(np.float64)
        assert abs(values.mean() - mean) < Z * sigma / math.sqrt(COUNT)
        assert abs(values.std() - sigma) < Z * sigma / math.sqrt(2 * COUNT)


def test_without_sigma_all_pixels_are_alike() -> None:
    theta = draw_pattern(sensor(0.0), 1)
    assert np.all(theta.on == np.float32(0.3))
    assert np.all(theta.off == np.float32(0.2))


def test_no_threshold_lies_under_the_floor() -> None:
    theta = draw_pattern(sensor(0.2), 1).off
    below = np.count_nonzero(theta == np.float32(FLOOR)) / COUNT
    share = 0.5 * math.erfc((0.2 - FLOOR) / 0.2 / math.sqrt(2))
    assert theta.min() == np.float32(FLOOR)
    assert abs(below - share) < Z * math.sqrt(share * (1 - share) / COUNT)


def test_a_pixels_threshold_does_not_depend_on_the_size_of_the_sensor() -> None:
    small, large = (draw_pattern(sensor(0.03, *size), 5) for size in ((40, 30), (640, 480)))
    assert np.array_equal(small.on, large.on[:30, :40])
    assert np.array_equal(small.off, large.off[:30, :40])
    assert not np.array_equal(small.on, draw_pattern(sensor(0.03, 40, 30), 6).on)


def test_two_thousand_events_use_most_microseconds_of_a_tick() -> None:
    generator = np.random.default_rng(2)
    model = PlainModel(SensorParameters("test", 100, 100, 0.2, 0.2, 0.03), 1)
    first = np.exp(generator.normal(-1, 0.5, (100, 100)))
    # a common drift, small against a threshold: one event in four or five pixels
    frames = [first * math.exp(0.055 * k) for k in range(12)]
    state = model.init(0)
    for k, frame in enumerate(frames):
        events, state = model.step(frame.astype(np.float32), state, k * 1000, (k + 1) * 1000)
        if k >= 8:  # by then the residuals have spread over the thresholds
            assert len(events) >= 2000
            assert len(np.unique(events["t"])) >= 800
