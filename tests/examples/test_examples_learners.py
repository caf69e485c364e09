"""The data of the page on learners: each sample is of its direction, and new in the test."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evs.examples.learners.directions import BINS, NAMES, SIZE, Directions, record


def centres(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much the ON events of a bin lie beside those of the bin before, modulo 16 px."""
    on = counts[:, 1]
    angles = 2 * np.pi * np.arange(SIZE[0]) / 16
    found = []
    for axis in (1, 2):
        # the phase of the pattern along x or y
        phase = np.angle((on.sum(axis) * np.exp(1j * angles)).sum(1))
        found.append(np.angle(np.exp(1j * np.diff(phase))))
    return found[0], found[1]


def test_samples_move_as_their_label_says(tmp_path: Path) -> None:
    data = Directions(record(tmp_path, samples=6, seed=3))
    # the last sample of each run ends before its span does
    assert len(data) >= 4 * 5
    signs = {"left": (0, -1), "right": (0, 1), "up": (1, -1), "down": (1, 1)}
    labels = []
    for index in range(len(data)):
        counts, label = data[index]
        assert counts.shape == (BINS, 2, SIZE[1], SIZE[0])
        assert counts.sum() > 100
        axis, sign = signs[NAMES[label]]
        # the first and last bins have the jump between samples
        assert sign * centres(counts)[axis][2:-1].sum() > 0.1, NAMES[label]
        labels.append(label)
    assert set(labels) == {0, 1, 2, 3}


def test_other_seeds_have_other_bars(tmp_path: Path) -> None:
    first, again, other = (
        Directions(record(tmp_path / name, samples=2, seed=seed))[0][0]
        for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
