"""The chi-square test of samplers, tested on samplers in NumPy that are right and wrong."""

from __future__ import annotations

import numpy as np
import pytest

from reference.chi_square import cell_integrals, p_of_counts, p_of_directions

pytestmark = pytest.mark.statistical
DRAWS = 200_000


def cosine_lobe(rng: np.random.Generator, power: float) -> np.ndarray:
    """(DRAWS, 3) directions with a density of cos^power around z."""
    z = rng.random(DRAWS) ** (1 / (power + 1))
    angle = 2 * np.pi * rng.random(DRAWS)
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], 1)


@pytest.mark.parametrize("power", [0.0, 1.0, 40.0])
def test_a_right_sampler_passes_and_a_wrong_one_does_not(power: float) -> None:
    rng = np.random.default_rng(0)
    drawn = cosine_lobe(rng, power)

    def density(wanted: float):
        above = (wanted + 1) / (2 * np.pi)
        return lambda w: above * np.maximum(w[..., 2], 0) ** wanted * (w[..., 2] > 0)

    assert cell_integrals(density(power), (24, 48)).sum() == pytest.approx(1, abs=1e-3)
    assert 1e-3 < p_of_directions(drawn, density(power)) < 1
    # a little more power, or a twentieth of a radian off the axis
    assert p_of_directions(drawn, density(power * 1.03 + 0.1)) < 1e-6
    turned = drawn @ [[1, 0, 0], [0, np.cos(0.05), np.sin(0.05)], [0, -np.sin(0.05), np.cos(0.05)]]
    assert p_of_directions(turned, density(power)) < 1e-6


def test_lost_draws_are_a_cell_of_their_own() -> None:
    rng = np.random.default_rng(1)
    drawn = cosine_lobe(rng, 1.0)
    kept = drawn[drawn[:, 0] > 0]

    def half(w: np.ndarray) -> np.ndarray:
        return np.where(w[..., 0] > 0, np.maximum(w[..., 2], 0) / np.pi, 0)

    assert p_of_directions(kept, half, len(drawn) - len(kept)) > 1e-3
    assert p_of_directions(kept, half, len(drawn) - len(kept) + 10_000) < 1e-6
    # a direction from where none can come
    assert p_of_directions(drawn, half) == 0


def test_a_density_over_one_is_refused() -> None:
    with pytest.raises(AssertionError, match=r"integral is 1\.1"):
        p_of_directions(np.array([[0, 0, 1.0]]), lambda w: np.full(w.shape[:-1], 1.1 / 4 / np.pi))


def test_p_is_uniform_where_the_sampler_is_right() -> None:
    rng = np.random.default_rng(2)
    share = rng.dirichlet(np.full(200, 0.3))
    p = [p_of_counts(rng.multinomial(5000, share).astype(float), 5000 * share) for _ in range(500)]
    # Kolmogorov's bound for 500 at 1e-4
    assert np.abs(np.sort(p) - (np.arange(500) + 0.5) / 500).max() < 2.23 / np.sqrt(500)
