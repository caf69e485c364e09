"""Voxel grids of events: where polarity goes, and how a grid is normalised."""

from __future__ import annotations

import numpy as np
import pytest

from evs.msgs import EVENT_DTYPE, Events
from evs_lab.reconstruction import normalised, voxel_grid

SHAPE = (6, 8)


def some(count: int = 3000, seed: int = 2) -> Events:
    random = np.random.default_rng(seed)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(random.integers(5000, 25_000, count))
    events["x"], events["y"] = random.integers(0, 8, count), random.integers(0, 6, count)
    events["p"] = random.random(count) < 0.6
    return events


def test_an_event_is_shared_between_its_nearest_bins() -> None:
    events = np.array(
        [(0, 0, 0, 1), (1300, 2, 1, 0), (2000, 3, 1, 1), (4000, 1, 0, 1)], EVENT_DTYPE
    )
    grid = voxel_grid(events, 5, (2, 4))
    expected = np.zeros((5, 2, 4))
    expected[0, 0, 0] = expected[2, 1, 3] = expected[4, 0, 1] = 1
    expected[1, 1, 2], expected[2, 1, 2] = -0.7, -0.3
    assert grid == pytest.approx(expected, abs=1e-7)
    assert grid.dtype == np.float32


@pytest.mark.parametrize("bins", [1, 2, 5, 10])
def test_the_sum_of_polarities_of_a_pixel_stays(bins: int) -> None:
    events = some()
    grid = voxel_grid(events, bins, SHAPE)
    assert grid.shape == (bins, *SHAPE)
    sums = np.zeros(SHAPE)
    np.add.at(sums, (events["y"], events["x"]), np.where(events["p"] == 1, 1, -1))
    assert grid.sum(axis=0, dtype=np.float64) == pytest.approx(sums, abs=1e-4)
    assert np.abs(sums).max() > 10


def test_the_mean_time_of_events_stays() -> None:
    events = some()
    events["p"] = 1
    total = voxel_grid(events, 5, SHAPE).sum(axis=(1, 2), dtype=np.float64)
    t = events["t"]
    place = 4 * (t - t[0]) / (t[-1] - t[0])
    assert total @ np.arange(5) == pytest.approx(place.sum(), rel=1e-6)


def test_no_events_and_events_of_one_stamp() -> None:
    assert not voxel_grid(some(0), 5, SHAPE).any()
    events = some(4)
    events["t"], events["p"] = 7, 1
    grid = voxel_grid(events, 5, SHAPE)
    assert grid[0].sum() == 4
    assert not grid[1:].any()


def test_normalised_entries_have_mean_0_and_deviation_1() -> None:
    grid = voxel_grid(some(60), 5, SHAPE)
    made = normalised(grid)
    filled = grid != 0
    assert not made[~filled].any()
    assert made.dtype == np.float32
    entries = made[filled].astype(np.float64)
    assert (entries.mean(), entries.std()) == pytest.approx((0, 1), abs=1e-6)
    assert 20 < np.count_nonzero(filled) < grid.size
    assert not normalised(np.zeros_like(grid)).any()
    assert not normalised(np.where(filled, np.float32(3), np.float32(0))).any()
