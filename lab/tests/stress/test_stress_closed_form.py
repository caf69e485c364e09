"""The closed form that extremes are held against, and that it can tell an event too many."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.msgs import Events, make_events
from evs_lab.stress.closed_form import (
    THETA,
    WHITE_DN,
    count_error,
    counts,
    event_counts,
    log_light,
    residual_thresholds,
)


def one_pixel(*levels: float) -> np.ndarray:
    return np.array(levels)[:, np.newaxis, np.newaxis]


def test_log_light_is_smooth_where_its_two_lines_touch() -> None:
    knee = math.e / WHITE_DN
    assert log_light(np.array(0.0)) == 0
    assert log_light(np.array(knee)) == pytest.approx(1.0)
    below, above = log_light(np.array([knee * 0.999, knee * 1.001]))
    assert above - 1 == pytest.approx(1 - below, rel=1e-2)


def test_a_step_owes_its_whole_thresholds_and_the_way_back_as_many() -> None:
    expected, certain = counts(one_pixel(0.1, 0.1 * math.exp(2.5 * THETA), 0.1, 0.1))
    assert certain.all()
    assert expected[:, :, 0, 0].tolist() == [[0, 0], [0, 2], [2, 0], [0, 0]]


def test_a_crossing_that_float32_cannot_tell_is_in_doubt() -> None:
    for beside, certain in ((1e-5, False), (1e-4, True)):
        _, certain = counts(one_pixel(0.1, 0.1 * math.exp((3 + beside) * THETA)))
        assert certain.all() == certain


def events_of(*ticks: tuple[int, int]) -> Events:
    """One at the middle of each (tick from 1, polarity)."""
    t = [tick * 1000 - 500 for tick, _ in ticks]
    return make_events(t, [0] * len(t), [0] * len(t), [p for _, p in ticks])


def test_one_event_too_many_or_too_few_is_seen() -> None:
    light = one_pixel(0.1, 0.1 * math.exp(2.5 * THETA), 0.1)
    right = [(1, 1), (1, 1), (2, 0), (2, 0)]
    assert count_error(events_of(*right), light, 1000) == 0
    assert count_error(events_of(*right[:-1]), light, 1000) == 1
    assert count_error(events_of(*right, (2, 1)), light, 1000) == 1
    # the same number in another tick is wrong twice
    assert count_error(events_of((1, 1), (2, 1), (2, 0), (2, 0)), light, 1000) == 2
    # a picture in doubt is no proof
    assert count_error(events_of(), one_pixel(0.1, 0.1 * math.exp(3 * THETA + 2e-6)), 1000) == (
        math.inf
    )


def test_events_tell_the_change_of_light_but_for_a_threshold() -> None:
    first, last = one_pixel(0.1, 0.1 * math.exp(2.5 * THETA))
    assert residual_thresholds(events_of((1, 1), (1, 1)), first, last) == pytest.approx(0.5)
    assert residual_thresholds(events_of((1, 1)), first, last) == pytest.approx(1.5)


def test_a_stamp_at_a_ticks_end_is_the_ticks() -> None:
    found = event_counts(make_events([1000, 1001], [0, 0], [0, 0], [1, 1]), 2, 1000, (1, 1))
    assert found[:, 1, 0, 0].tolist() == [0, 1, 1]
