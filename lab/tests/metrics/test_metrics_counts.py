"""Count ratios and rate maps against numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.msgs import EvsError, empty_events, make_events
from evs_lab.metrics import (
    Window,
    compare_rate_maps,
    count_loss,
    count_map,
    count_ratio,
)


def test_ratios_by_polarity() -> None:
    events = make_events([1, 2, 3, 4], [0] * 4, [0] * 4, [1, 1, 1, 0])
    reference = make_events([1, 2, 3, 4], [0] * 4, [0] * 4, [1, 1, 0, 0])
    ratio = count_ratio(events, reference)
    assert (ratio.on, ratio.off, ratio.all) == (1.5, 0.5, 1.0)
    on_only = count_ratio(events, reference[:2])
    assert (on_only.on, on_only.all) == (1.5, 2.0)
    assert math.isnan(on_only.off)
    assert math.isnan(count_ratio(events, empty_events()).all)
    assert count_ratio(empty_events(), reference).all == 0


def test_a_map_is_rows_of_y() -> None:
    events = make_events([1, 2, 3], [2, 2, 0], [0, 0, 1], [1, 0, 1])
    counts = count_map(events, Window(3, 2, 0, 10))
    assert counts.tolist() == [[0, 0, 2], [1, 0, 0]]
    assert counts.dtype == np.int64


def test_count_loss_is_the_mean_absolute_difference() -> None:
    assert count_loss(np.array([[3, 0]]), np.array([[1, 5]])) == (2 + 5) / 2


def test_maps_by_hand() -> None:
    counts, reference = np.array([[3, 1]]), np.array([[1, 3]])
    maps = compare_rate_maps(counts, reference, duration_s=0.5)
    # differences of 2 events in half a second: 4 Hz at either pixel
    assert maps.rmse_hz == 4.0
    assert maps.correlation == -1.0
    # shares with half an event added: (1.5, 3.5) / 5 against (3.5, 1.5) / 5
    assert maps.kl_nats == pytest.approx(0.3 * math.log(0.3 / 0.7) + 0.7 * math.log(0.7 / 0.3))


def test_rmse_squares_before_it_averages() -> None:
    maps = compare_rate_maps(np.array([[3, 0, 0, 1]]), np.array([[0, 4, 0, 1]]), duration_s=1.0)
    assert maps.rmse_hz == pytest.approx(math.sqrt((9 + 16) / 4))


def test_the_divergence_has_a_direction() -> None:
    counts, reference = np.array([[0, 9]]), np.array([[4, 5]])
    q, p = (0.05, 0.95), (0.45, 0.55)
    expected = p[0] * math.log(p[0] / q[0]) + p[1] * math.log(p[1] / q[1])
    assert compare_rate_maps(counts, reference, 1.0).kl_nats == pytest.approx(expected)
    assert compare_rate_maps(reference, counts, 1.0).kl_nats != pytest.approx(expected)


def test_correlation_by_hand() -> None:
    # deviations (-1, 0, 1) and (-2, 1, 1): covariance 3, squares 2 and 6
    maps = compare_rate_maps(np.array([[0, 1, 2]]), np.array([[0, 3, 3]]), 1.0)
    assert maps.correlation == pytest.approx(3 / math.sqrt(12))


def test_an_even_map_has_no_correlation() -> None:
    still = compare_rate_maps(np.zeros((2, 2), np.int64), np.zeros((2, 2), np.int64), 1.0)
    assert (still.rmse_hz, still.kl_nats) == (0.0, 0.0)
    assert math.isnan(still.correlation)
    assert math.isnan(compare_rate_maps(np.array([[0, 1]]), np.array([[2, 2]]), 1.0).correlation)


def test_twice_the_events_in_the_same_places() -> None:
    reference = np.array([[0, 100, 300]])
    maps = compare_rate_maps(2 * reference, reference, 1.0)
    assert maps.correlation == pytest.approx(1.0)
    assert maps.kl_nats < 0.001


def test_maps_that_do_not_fit() -> None:
    with pytest.raises(EvsError, match="two of one size"):
        compare_rate_maps(np.zeros((2, 3), np.int64), np.zeros((3, 2), np.int64), 1.0)
    with pytest.raises(EvsError, match="two of one size"):
        count_loss(np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64))
    with pytest.raises(EvsError, match="duration_s is 0"):
        compare_rate_maps(np.zeros((1, 1), np.int64), np.zeros((1, 1), np.int64), 0)
