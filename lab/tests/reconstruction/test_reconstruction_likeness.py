"""Equalised pictures, SSIM, and the energy of the Laplacian against plain code and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from evs_lab.reconstruction import correlation, equalise, laplacian_energy, ssim

RANDOM = np.random.default_rng(6)
PICTURE = RANDOM.random((24, 30)) ** 2
OTHER = PICTURE + RANDOM.normal(0, 0.1, PICTURE.shape)


def test_equalised_is_what_opencv_makes_of_8_bits() -> None:
    grey = np.rint(255 * PICTURE).astype(np.uint8)
    theirs = cv2.equalizeHist(grey)
    assert 255 * equalise(PICTURE, 1 / 255) == pytest.approx(theirs, abs=0.5)
    assert len(np.unique(theirs)) > 100


def test_only_the_order_of_grey_values_counts() -> None:
    # multiples of a step, so that no two of them are taken for one on either scale
    levels = RANDOM.integers(1, 40, (20, 20)).astype(float)
    assert np.array_equal(equalise(levels, 1.0), equalise(levels**3, 1.0))
    flipped = equalise(-levels, 1.0)
    assert correlation(flipped, equalise(levels, 1.0)) < -0.99


def test_less_than_a_step_is_no_contrast() -> None:
    even = 0.7 + 1e-7 * PICTURE
    assert np.array_equal(equalise(even, 1 / 255), np.full(even.shape, 0.5))


def test_ssim_is_that_of_plain_loops() -> None:
    weights = np.array([np.exp(-0.5 * (k / 1.5) ** 2) for k in range(-5, 6)])
    window = np.outer(weights, weights) / weights.sum() ** 2
    found = []
    for y in range(PICTURE.shape[0] - 10):
        for x in range(PICTURE.shape[1] - 10):
            one, two = (image[y : y + 11, x : x + 11] for image in (OTHER, PICTURE))
            m1, m2 = (window * one).sum(), (window * two).sum()
            v1, v2 = (window * (one - m1) ** 2).sum(), (window * (two - m2) ** 2).sum()
            both = (window * (one - m1) * (two - m2)).sum()
            light = (2 * m1 * m2 + 1e-4) / (m1**2 + m2**2 + 1e-4)
            found.append(light * (2 * both + 9e-4) / (v1 + v2 + 9e-4))
    assert ssim(OTHER, PICTURE, span=1.0) == pytest.approx(np.mean(found), rel=1e-9)
    assert 0.1 < np.mean(found) < 0.95
    assert ssim(PICTURE, PICTURE) == pytest.approx(1.0)


def test_ssim_of_a_shift_in_brightness_is_its_luminance_term() -> None:
    truth = np.tile([0.0, 1.0], (16, 8))
    means = 0.5, 0.7
    found = ssim(truth + 0.2, truth)
    c1 = 0.01**2
    term = (2 * means[0] * means[1] + c1) / (means[0] ** 2 + means[1] ** 2 + c1)
    # a window's own mean is 1/2 to within the smallest of its weights
    assert found == pytest.approx(term, abs=2e-3)


def test_correlation_of_a_blank_is_zero() -> None:
    assert correlation(np.full(PICTURE.shape, 0.5), PICTURE) == 0.0
    assert correlation(OTHER, PICTURE) == pytest.approx(
        np.corrcoef(OTHER.ravel(), PICTURE.ravel())[0, 1]
    )


def test_energy_of_the_laplacian_of_a_point_and_of_a_ramp() -> None:
    point = np.zeros((12, 22))
    point[5, 7] = 0.1
    # -4 on the point and 1 on each neighbour; the outermost pixels do not count
    assert laplacian_energy(point) == pytest.approx((16 + 4) * 25.5**2 / (10 * 20))
    ramp = np.add.outer(np.arange(12.0), 2 * np.arange(22.0)) / 60
    assert laplacian_energy(ramp) == pytest.approx(0, abs=1e-20)


def test_energy_of_the_laplacian_is_that_of_opencv() -> None:
    theirs = cv2.Laplacian(255 * PICTURE, cv2.CV_64F)[1:-1, 1:-1]
    assert laplacian_energy(PICTURE) == pytest.approx(np.mean(theirs**2))


def test_noise_has_energy_of_its_own() -> None:
    """White noise of deviation s: 20 s^2; the energy of a picture and its noise add up."""
    smooth = np.tile(np.linspace(0.2, 0.8, 200), (200, 1))
    s = 0.05
    noisy = smooth + RANDOM.normal(0, s, smooth.shape)
    # of a mean of 198^2 squares whose neighbours overlap: 5 sigma, with a tenth of them counted
    bound = 5 * np.sqrt(2 / (0.1 * 198**2))
    assert laplacian_energy(noisy) == pytest.approx(20 * (255 * s) ** 2, rel=bound)
