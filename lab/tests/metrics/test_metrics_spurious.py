"""Unmatched events and their stamps, counted by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.msgs import EvsError, empty_events, make_events
from evs_lab.metrics import (
    Window,
    match_events,
    measure_spurious,
    measure_timing,
    static_pixels,
)

HALF_SECOND = Window(width=5, height=4, t_begin_us=0, t_end_us=500_000)


def test_rates_overall_and_on_static_pixels() -> None:
    reference = make_events([1000], [0], [0], [1])
    # found; a duplicate beside the edge; two ghosts far from it
    events = make_events([1000, 1100, 2000, 3000], [0, 1, 4, 4], [0, 1, 3, 3], [1, 1, 0, 1])
    static = static_pixels(reference, HALF_SECOND, margin_px=1)
    assert np.argwhere(~static).tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]]
    found = measure_spurious(events, match_events(events, reference), HALF_SECOND, static)
    assert (found.events, found.static_events, found.static_px) == (3, 2, 16)
    assert found.rate_hz == 3 / 20 / 0.5
    assert found.static_rate_hz == 2 / 16 / 0.5


def test_a_mask_of_ones_own() -> None:
    events = make_events([10, 20], [0, 1], [0, 0], [1, 1])
    mask = np.zeros((4, 5), np.bool_)
    mask[0, 1] = True
    unmatched = match_events(events, empty_events())
    found = measure_spurious(events, unmatched, HALF_SECOND, mask)
    assert (found.static_px, found.static_events, found.static_rate_hz) == (1, 1, 2.0)
    nowhere = measure_spurious(events, unmatched, HALF_SECOND, np.zeros_like(mask))
    assert math.isnan(nowhere.static_rate_hz)
    assert nowhere.rate_hz == 2 / 20 / 0.5


@pytest.mark.parametrize("mask", [np.ones((5, 4), np.bool_), np.ones((4, 5), np.int8)])
def test_a_mask_that_does_not_fit(mask: np.ndarray) -> None:
    none = empty_events()
    with pytest.raises(EvsError, match=r"give bool \(4, 5\)"):
        measure_spurious(none, match_events(none, none), HALF_SECOND, mask)


@pytest.mark.parametrize("margin", [0, 1, 2, 3, 9])
def test_static_pixels_keep_their_distance(margin: int) -> None:
    reference = make_events([1, 2], [1, 4], [3, 0], [0, 1])
    y, x = np.mgrid[:4, :5]
    away = np.minimum(
        np.maximum(abs(x - 1), abs(y - 3)),
        np.maximum(abs(x - 4), abs(y - 0)),
    )
    assert (static_pixels(reference, HALF_SECOND, margin) == (away > margin)).all()


def test_everything_is_static_where_nothing_happens() -> None:
    assert static_pixels(empty_events(), HALF_SECOND).all()
    with pytest.raises(EvsError, match="margin_px is -1"):
        static_pixels(empty_events(), HALF_SECOND, -1)


def test_stamp_errors() -> None:
    # far apart in x: each event has one possible partner
    places, ones = [0, 10, 20, 30, 40], [1] * 5
    reference = make_events([10_000] * 5, places, [0] * 5, ones)
    events = make_events([10_000 + e for e in (-400, -100, 200, 300, 1000)], places, [0] * 5, ones)
    error = measure_timing(events, reference, match_events(events, reference))
    assert (error.pairs, error.median_us) == (5, 200.0)
    assert error.iqr_us == 300 - -100
    assert error.median_abs_us == 300.0
    early = measure_timing(reference, events, match_events(reference, events))
    assert (early.median_us, early.iqr_us, early.median_abs_us) == (-200.0, 400.0, 300.0)


def test_quartiles_lie_between() -> None:
    reference = make_events([0, 0], [0, 10], [0, 0], [1, 1])
    events = make_events([0, 100], [0, 10], [0, 0], [1, 1])
    error = measure_timing(events, reference, match_events(events, reference))
    assert (error.median_us, error.iqr_us, error.median_abs_us) == (50.0, 50.0, 50.0)


def test_no_pair_has_no_error() -> None:
    one = make_events([0], [0], [0], [1])
    error = measure_timing(one, empty_events(), match_events(one, empty_events()))
    assert error.pairs == 0
    assert all(math.isnan(v) for v in (error.median_us, error.iqr_us, error.median_abs_us))
