"""One-to-one pairs on streams whose pairs can be counted by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.msgs import Events, EvsError, empty_events, make_events
from evs_lab.metrics import match_events, matching


def stream(*events: tuple[int, int, int, int]) -> Events:
    """Events (t, x, y, p), in the order written."""
    t, x, y, p = zip(*events, strict=True) if events else ((), (), (), ())
    return make_events(t, x, y, p)


ONE = stream((10_000, 5, 5, 1))


@pytest.mark.parametrize(
    ("event", "pairs"),
    [
        ((10_000, 5, 5, 1), 1),
        ((13_000, 5, 5, 1), 1),  # both bounds are closed
        ((7_000, 5, 5, 1), 1),
        ((13_001, 5, 5, 1), 0),
        ((6_999, 5, 5, 1), 0),
        ((10_000, 6, 4, 1), 1),  # a diagonal neighbour is one pixel away
        ((13_000, 4, 6, 1), 1),
        ((10_000, 7, 5, 1), 0),
        ((10_000, 5, 3, 1), 0),
        ((10_000, 5, 5, 0), 0),  # the other polarity
    ],
)
def test_which_events_may_be_a_pair(event: tuple[int, int, int, int], pairs: int) -> None:
    assert match_events(stream(event), ONE).pairs == pairs


def test_tolerances_are_arguments() -> None:
    near = stream((10_010, 7, 5, 1))
    assert match_events(near, ONE, tolerance_us=10, tolerance_px=2).pairs == 1
    assert match_events(near, ONE, tolerance_us=9, tolerance_px=2).pairs == 0
    assert match_events(near, ONE, tolerance_us=10, tolerance_px=1).pairs == 0
    assert match_events(ONE, ONE, tolerance_us=0, tolerance_px=0).pairs == 1


def test_recall_and_precision() -> None:
    reference = stream((1000, 0, 0, 1), (2000, 10, 0, 0), (3000, 20, 0, 1), (4000, 30, 0, 1))
    events = stream(
        (1500, 1, 1, 1), (2000, 10, 0, 1), (3000, 20, 0, 1), (3001, 20, 0, 1), (9, 9, 9, 0)
    )
    found = match_events(events, reference)
    assert found.event_index.tolist() == [0, 2]
    assert found.reference_index.tolist() == [0, 2]
    assert (found.events, found.references, found.pairs) == (5, 4, 2)
    assert found.recall == 2 / 4
    assert found.precision == 2 / 5
    assert found.unmatched().tolist() == [False, True, False, True, True]


def test_a_chain_that_one_path_must_shift_from_end_to_end() -> None:
    # each event is nearest to the reference before it; only shifting all of them pairs all
    n = 60
    events = make_events(np.arange(n) * 5000, [3] * n, [3] * n, [1] * n)
    reference = make_events(np.arange(n) * 5000 + 2900, [3] * n, [3] * n, [1] * n)
    assert match_events(events, reference).pairs == n
    # the first reference now lies nearer to the second event, and so on
    assert match_events(events[1:], reference).pairs == n - 1
    assert match_events(events, reference[:-1]).pairs == n - 1


def test_same_pixel_before_nearer_in_time() -> None:
    events = stream((1000, 5, 5, 1), (1000, 6, 5, 1))
    reference = stream((3000, 5, 5, 1))
    assert match_events(events, reference).event_index.tolist() == [0]
    choice = stream((1000, 4, 5, 1), (3000, 5, 5, 1))
    assert match_events(events[:1], choice).reference_index.tolist() == [1]
    # but never at the price of a pair
    assert match_events(events, choice).reference_index.tolist() == [0, 1]


def test_nearer_in_time_then_the_earlier() -> None:
    events = stream((1000, 5, 5, 1), (1900, 5, 5, 1), (3000, 5, 5, 1))
    assert match_events(events, stream((2000, 5, 5, 1))).event_index.tolist() == [1]
    assert match_events(events[[0, 2]], stream((2000, 5, 5, 1))).event_index.tolist() == [0]


def test_rows_do_not_touch_at_their_ends() -> None:
    # x = 9 of row 0 and x = 0 of row 1 are neighbours in memory only
    assert match_events(stream((0, 9, 0, 1)), stream((0, 0, 1, 1))).pairs == 0
    last_of_column = stream((10_000, 5, 4, 1))
    assert match_events(last_of_column, stream((10_000, 5, 5, 1), (0, 5, 6, 1))).pairs == 1


def test_a_burst_in_one_pixel() -> None:
    burst = stream(*[(1000, 2, 2, 1)] * 57)
    assert match_events(burst, burst).pairs == 57
    assert match_events(burst, burst[:40]).recall == 1.0
    assert match_events(burst, burst[:40]).precision == 40 / 57


def test_nothing_to_find_and_nothing_found_are_not_a_share() -> None:
    nothing = empty_events()
    silent = match_events(nothing, ONE)
    assert silent.recall == 0
    assert math.isnan(silent.precision)
    ghost = match_events(ONE, nothing)
    assert math.isnan(ghost.recall)
    assert ghost.precision == 0
    assert match_events(nothing, nothing).pairs == 0


def test_stamps_and_pixels_at_the_ends_of_their_range() -> None:
    late = stream((2**60, 32767, 32767, 1), (2**60 - 3000, 32767, 32766, 1))
    assert match_events(late, late[::-1]).pairs == 2
    early = stream((-(2**60), -32768, -32768, 0))
    assert match_events(early, early).pairs == 1
    assert match_events(ONE, ONE, tolerance_us=2**62).pairs == 1


def test_what_does_not_fit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(EvsError, match="shorter windows"):
        match_events(stream((0, 0, 0, 1), (2**60, 30000, 30000, 1)), ONE)
    monkeypatch.setattr(matching, "MAX_PAIRS", 3)
    two = stream((0, 0, 0, 1), (0, 0, 0, 1))
    with pytest.raises(EvsError, match="4 pairs of events lie within the tolerances"):
        match_events(two, two)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"tolerance_us": -1}, "tolerance_us is -1"),
        ({"tolerance_us": 1.5}, "tolerance_us is 1.5"),
        ({"tolerance_px": -1}, "tolerance_px is -1"),
        ({"tolerance_px": 17}, "at most 16 px"),
        ({"tolerance_px": True}, "tolerance_px is True"),
    ],
)
def test_tolerances_without_sense(arguments: dict[str, int], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        match_events(ONE, ONE, **arguments)


def test_what_is_no_event_stream() -> None:
    with pytest.raises(EvsError, match="events are no events"):
        match_events(np.zeros(3), ONE)
    with pytest.raises(EvsError, match="reference have 2 dimensions"):
        match_events(ONE, empty_events(4).reshape(2, 2))
