"""V(0): uniform between the thresholds, of the seed and the pixel alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.sensor import SensorParameters
from reference.networks import random_network


def membranes(
    seed: int, width: int = 400, height: int = 300, initial: str = "random", off: float = 0.3
) -> F32:
    sensor = SensorParameters("test", width, height, 0.1, off)
    weights = random_network(0, 1, blocks=0)
    return EvsNetModel(sensor, weights, runtime="reference", initial=initial).init(seed).v


@pytest.mark.statistical
@pytest.mark.parametrize("seed", [0, 1, 2**63])
def test_uniform_between_the_thresholds(seed: int) -> None:
    v = membranes(seed).reshape(-1).astype(np.float64)
    # V_on = .5, V_off = 1.5 of the network's .2: the share of each, not the membrane, is uniform
    share = np.sort(np.where(v > 0, v / 0.5, v / 1.5))
    assert -1 < share[0] < -0.999
    assert 0.999 < share[-1] < 1
    # Kolmogorov and Smirnov: the chance of a larger distance is 2 e^(-2 z^2) = 1e-6
    n = len(share)
    cdf = (share + 1) / 2
    distance = max(
        np.max(np.arange(1, n + 1) / n - cdf), np.max(cdf - np.arange(n) / n)
    )  # fmt: skip
    assert distance < math.sqrt(-math.log(0.5e-6) / 2 / n)


@pytest.mark.statistical
def test_neighbours_and_seeds_are_independent() -> None:
    """Correlations of n products of uniform numbers have the deviation 1 / sqrt(n)."""
    v = membranes(5, off=0.1).astype(np.float64) / 0.5
    other = membranes(6, off=0.1).astype(np.float64) / 0.5
    for a, b in ((v[:, 1:], v[:, :-1]), (v[1:], v[:-1]), (v, other)):
        correlation = float(np.mean(a * b)) * 3  # the variance of U(-1, 1) is 1 / 3
        assert abs(correlation) < 5 / math.sqrt(a.size)


def test_no_pixel_starts_on_a_threshold() -> None:
    """It would fire in still light. float32 rounds 1 - 2^-25 to 1."""
    for seed in range(3):
        v = membranes(seed)
        assert np.all(v < np.float32(0.1 / 0.2))
        assert np.all(v > -np.float32(0.3 / 0.2))


def test_a_rounded_share_of_one_stays_below(monkeypatch: pytest.MonkeyPatch) -> None:
    from evs.emulator.evsnet import model as module

    ends = np.array([[0.0, 1 - 2.0**-53, 0.5]])
    monkeypatch.setattr(module, "pixel_uniforms", lambda *_: ends)
    v = membranes(0, 3, 1)
    assert v[0, 0] == -np.nextafter(np.float32(1.5), np.float32(0))
    assert v[0, 1] == np.nextafter(np.float32(0.5), np.float32(0))
    assert v[0, 2] == 0


def test_the_size_of_the_sensor_moves_no_number() -> None:
    large, small = membranes(9, 50, 40), membranes(9, 31, 7)
    assert np.array_equal(large[:7, :31], small)


def test_the_seed_does_and_counts_modulo_2_to_the_64() -> None:
    assert not np.array_equal(membranes(1, 9, 9), membranes(2, 9, 9))
    assert np.array_equal(membranes(1, 9, 9), membranes(1 + 2**64, 9, 9))


def test_zero_is_zero() -> None:
    assert not np.any(membranes(3, initial="zero"))


def test_its_number_is_no_other_terms() -> None:
    from evs.emulator.sensor.random import Term, pixel_uniforms

    ours = pixel_uniforms(3, Term.INTERNAL_STATE, 20, 20)
    for term in Term:
        if term is not Term.INTERNAL_STATE:
            assert not np.any(pixel_uniforms(3, term, 20, 20) == ours)
