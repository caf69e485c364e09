"""The events that a network should give: phases, counts, and where they come from."""

from __future__ import annotations

import numpy as np
import pytest

from evs_lab.training.targets import IDEAL, NOISY, draw_phases, event_counts


def ladder(changes: list[float], pixels: int = 1) -> np.ndarray:
    """(K, P) luminance whose log goes up by these changes, all of it in the logarithmic part."""
    log = np.concatenate([[0.0], np.cumsum(changes)])
    return np.repeat(0.5 * np.exp(log)[:, np.newaxis], pixels, 1).astype(np.float32)


@pytest.mark.parametrize(
    ("phase", "changes", "on", "off"),
    [
        # theta is .2: half a threshold is missing, or already there
        (0.0, [0.19, 0.02, 0.2], [0, 0, 1, 1], [0, 0, 0, 0]),
        (0.5, [0.11, 0.2], [0, 1, 1], [0, 0, 0]),
        (0.5, [0.09, 0.02], [0, 0, 1], [0, 0, 0]),
        (0.5, [-0.29, -0.02], [0, 0, 0], [0, 0, 1]),
        (-0.5, [-0.11, 0.11], [0, 0, 0], [0, 1, 0]),
        (-0.5, [0.31, 0.0], [0, 1, 0], [0, 0, 0]),
        (0.0, [1.01, -1.01], [0, 5, 0], [0, 0, 5]),
    ],
)
def test_the_phase_is_the_part_of_a_threshold_that_is_there(phase, changes, on, off) -> None:
    counts = event_counts(ladder(changes), np.array([phase], np.float32), IDEAL)
    np.testing.assert_array_equal(counts[:, :, 0], [on, off])


def test_counts_are_those_of_a_staircase_in_numpy() -> None:
    # the ideal pixel written anew: levels at phase + n thresholds
    rng = np.random.default_rng(4)
    pixels, ticks = 40, 300
    log = np.cumsum(rng.normal(0.0, 0.15, (ticks, pixels)), 0)
    truth = np.exp(0.3 * np.tanh(log)).astype(np.float32)
    phase = draw_phases(rng, pixels)
    counts = event_counts(truth, phase, IDEAL)
    for pixel in range(pixels):
        light = np.log(255.0 * truth[:, pixel].astype(np.float64))
        reference = light[0] - 0.2 * float(phase[pixel])
        for tick in range(1, ticks):
            rise = (light[tick] - reference) / 0.2
            # a pixel this close to a level may fall on either side of it by rounding
            assert abs(rise - round(rise)) > 1e-5 or round(rise) == 0
            on, off = max(0, int(rise)), max(0, int(-rise))
            assert (counts[0, tick, pixel], counts[1, tick, pixel]) == (on, off)
            reference += 0.2 * (on - off)


def test_still_light_is_silent_whatever_the_phase() -> None:
    phase = draw_phases(np.random.default_rng(1), 500)
    truth = np.full((60, 500), 0.3, np.float32)
    assert not event_counts(truth, phase, IDEAL).any()
    assert np.all(np.abs(phase) < 1)
    assert abs(float(phase.mean())) < 4 * np.sqrt(1 / 3 / 500)


def test_noise_follows_from_its_seed_alone() -> None:
    rng = np.random.default_rng(2)
    truth = np.repeat(rng.uniform(0.0, 1e-3, (1, 300)), 200, 0).astype(np.float32)
    phase = draw_phases(rng, 300)
    first = event_counts(truth, phase, NOISY, seed=5)
    np.testing.assert_array_equal(first, event_counts(truth, phase, NOISY, seed=5))
    assert np.any(first != event_counts(truth, phase, NOISY, seed=6))
    # the dark gives shot noise, and the first tick none
    assert first.any()
    assert not first[:, 0].any()
