"""The complementary filter of events against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from evs_lab.reconstruction import complementary_filter
from reference.esim import EVENT

CUTOFF_RAD_S = 6.0


def test_the_filter_of_two_events_is_its_closed_form() -> None:
    events = np.array([(30_000, 1, 0, 0), (10_000, 1, 0, 1)], EVENT)
    state = complementary_filter(events, (1, 3), [5_000, 10_000, 50_000], 0.2, CUTOFF_RAD_S)
    late = 0.2 * (np.exp(-CUTOFF_RAD_S * 0.04) - np.exp(-CUTOFF_RAD_S * 0.02))
    expected = [[[0, 0, 0]], [[0, 0.2, 0]], [[0, late, 0]]]
    assert state == pytest.approx(np.array(expected), abs=1e-15)


def test_events_are_read_once_however_often_the_state_is() -> None:
    events = np.array([(t, 0, 0, 1) for t in range(0, 90_000, 1000)], EVENT)
    often = complementary_filter(events, (1, 1), list(range(0, 100_001, 500)), 0.1, CUTOFF_RAD_S)
    once = complementary_filter(events, (1, 1), [100_000], 0.1, CUTOFF_RAD_S)
    assert often[-1] == pytest.approx(once[0], rel=1e-12)
