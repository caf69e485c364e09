"""The paper's earth mover's distance on sequences worked out by hand."""

from __future__ import annotations

import pytest

from evs.msgs import Events, EvsError, empty_events, make_events
from evs_lab.metrics import Window, emd_map, mean_emd

TEN = Window(width=1, height=1, t_begin_us=0, t_end_us=10_000)


def at_ticks(*ticks: int, p: int = 1) -> Events:
    """One pixel's events in the middle of the ticks 1 ... K."""
    n = len(ticks)
    return make_events([k * 1000 - 500 for k in ticks], [0] * n, [0] * n, [p] * n)


@pytest.mark.parametrize(
    ("events", "reference", "expected"),
    [
        ((), (), 0),
        ((4,), (4,), 0),
        # the running sums differ in ticks 4, 5, 6
        ((7,), (4,), 3 / 10),
        ((1,), (10,), 9 / 10),
        # pairs in order: 2 with 3, 9 with 5
        ((2, 9), (3, 5), (1 + 4) / 10),
        ((5, 5), (4, 8), (1 + 3) / 10),
        # one event too many or too few: (K + 1) / 2K wherever it is
        ((4,), (), 11 / 20),
        ((1,), (), 11 / 20),
        ((), (10,), 11 / 20),
        ((2, 2, 7), (), 33 / 20),
        # forwards 3 goes to 4 and 8 past the end: 1 + 3; backwards 8 to 4 and 3 before it: 4 + 3
        ((3, 8), (4,), (4 + 7) / 20),
        ((4,), (3, 8), (4 + 7) / 20),
    ],
)
def test_one_pixel(events: tuple[int, ...], reference: tuple[int, ...], expected: float) -> None:
    found = emd_map(at_ticks(*events), at_ticks(*reference), TEN)
    assert found.shape == (2, 1, 1)
    assert found[1, 0, 0] == pytest.approx(expected)
    assert found[0, 0, 0] == 0


def test_polarities_are_apart_and_added() -> None:
    on, off = at_ticks(4), at_ticks(7, p=0)
    found = emd_map(on, off, TEN)
    assert found.ravel().tolist() == [11 / 20, 11 / 20]
    assert mean_emd(on, off, TEN) == pytest.approx(11 / 10)
    assert emd_map(off, at_ticks(2, p=0), TEN).ravel().tolist() == [5 / 10, 0]


def test_pixels_are_apart_and_averaged() -> None:
    window = Window(width=3, height=2, t_begin_us=0, t_end_us=10_000)
    events = make_events([1500, 4500, 8500], [2, 0, 2], [1, 0, 0], [1, 0, 1])
    reference = make_events([1500, 3500, 5500], [2, 2, 0], [1, 1, 0], [1, 1, 0])
    found = emd_map(events, reference, window)
    assert found.shape == (2, 2, 3)
    assert found[0].tolist() == [[1 / 10, 0, 0], [0, 0, 0]]
    # ticks 2 and 2, 4: forwards 4 goes past the end, 7; backwards 4 goes to 2 and 2 before it, 4
    assert found[1].tolist() == [[0, 0, 11 / 20], [0, 0, 11 / 20]]
    assert mean_emd(events, reference, window) == pytest.approx((2 + 11 + 11) / 20 / 6)


def test_tick_k_owns_its_end() -> None:
    # 2000 is the last stamp of tick 2, 2001 the first of tick 3
    events = make_events([2000], [0], [0], [1])
    assert emd_map(events, make_events([1001], [0], [0], [1]), TEN)[1, 0, 0] == 0
    assert emd_map(events, make_events([2001], [0], [0], [1]), TEN)[1, 0, 0] == pytest.approx(0.1)


def test_only_the_window_counts() -> None:
    # 0 belongs to the tick before, 10001 to the one after
    outside = make_events([-5, 0, 10_001], [0, 9, 0], [0] * 3, [1] * 3)
    assert emd_map(outside, empty_events(), TEN).sum() == 0
    assert emd_map(make_events([10_000], [0], [0], [1]), empty_events(), TEN).sum() == 11 / 20


def test_the_tick_sets_the_grain() -> None:
    events, reference = make_events([120], [0], [0], [1]), make_events([990], [0], [0], [1])
    assert emd_map(events, reference, TEN).sum() == 0
    assert emd_map(events, reference, TEN, tick_us=1).sum() == pytest.approx(870 / 10_000)


@pytest.mark.parametrize(
    ("tick_us", "says"), [(3000, "move t_end_us back by 1000 us"), (0, "tick_us"), (0.5, "tick_us")]
)
def test_ticks_that_do_not_fit(tick_us: int, says: str) -> None:
    with pytest.raises(EvsError, match=says):
        emd_map(empty_events(), empty_events(), TEN, tick_us)
