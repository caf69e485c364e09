"""What the study of other simulators measures: counts, histograms, their distance, stamps."""

from __future__ import annotations

import numpy as np
import pytest

from reference.esim import EVENT
from reference.intensity import (
    binned,
    counts_of,
    earth_mover,
    frame_times_us,
    histogram,
    tenths,
    total_variation,
)

EDGES_US = frame_times_us(4)


def test_a_voxel_has_its_later_edge() -> None:
    assert EDGES_US == [0, 17_000, 33_000, 50_000]
    events = np.zeros(5, EVENT)
    events["t"] = [0, 1, 17_000, 17_001, 50_001]
    events["x"], events["y"] = 2, 1
    counts = counts_of(events, (2, 3), EDGES_US)
    assert counts[:, 1, 2].tolist() == [2, 1, 0]
    assert counts.sum() == 3


def test_the_histogram_of_known_counts() -> None:
    shares = histogram(np.array([[[0, 0, 1, 12]]]))
    assert shares[[0, 1, 12]].tolist() == [0.5, 0.25, 0.25]
    assert binned(shares)[[0, 1, 10]].tolist() == [0.5, 0.25, 0.25]
    assert binned(np.array([0.75, 0.25])).tolist() == [0.75, 0.25] + 9 * [0.0]


def test_distances_of_known_histograms() -> None:
    one, other = np.array([0.5, 0.5]), np.array([0.5, 0.0, 0.0, 0.5])
    assert total_variation(one, other) == 0.5
    # half of the voxels have two events more
    assert earth_mover(one, other) == earth_mover(other, one) == 1.0
    assert earth_mover(one, one) == total_variation(other, other) == 0.0
    # what lies beyond the last bin counts for the mover only
    many, more = np.eye(31)[20], np.eye(31)[30]
    assert (total_variation(many, more), earth_mover(many, more)) == (0.0, 10.0)


@pytest.mark.parametrize("edges_us", [EDGES_US, [0, 1000, 2000]])
def test_even_stamps_fill_the_tenths_evenly(edges_us: list[int]) -> None:
    every = np.arange(-5, edges_us[-1] + 6)
    assert np.allclose(tenths(every, edges_us), 0.1)


def test_stamps_at_the_end_of_a_tick_are_in_its_last_tenth() -> None:
    stamps = np.array([1000, 2000, 3000])
    assert tenths(stamps, [0, 1000, 2000, 3000])[9] == 1.0
    assert np.isnan(tenths(stamps[:0], EDGES_US)).all()
