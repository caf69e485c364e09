"""Earth mover's distance and the summary on any two streams."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.msgs import Events, join_events, make_events
from evs_lab.metrics import Window, compare, emd_map, mean_emd

pytestmark = pytest.mark.property

K = 12
WINDOW = Window(width=4, height=3, t_begin_us=5000, t_end_us=5000 + K * 1000)
TICKS = st.lists(st.integers(1, K), max_size=6)
STREAMS = st.lists(
    st.tuples(
        st.integers(5001, 5000 + K * 1000), st.integers(0, 3), st.integers(0, 2), st.integers(0, 1)
    ),
    max_size=40,
).map(lambda rows: make_events(*np.array(rows, np.int64).reshape(-1, 4).T))


def one_pixel(ticks: list[int]) -> Events:
    n = len(ticks)
    return make_events([5000 + 1000 * k for k in ticks], [2] * n, [1] * n, [1] * n)


def cheapest_transport(first: list[int], second: list[int], rest: int) -> int:
    """Least total way in ticks, over all assignments; the shorter list is filled with `rest`."""
    n = max(len(first), len(second))
    first, second = ([*part, *[rest] * (n - len(part))] for part in (first, second))
    return min(
        sum(abs(a - b) for a, b in zip(first, order, strict=True)) for order in permutations(second)
    )


@settings(max_examples=100, deadline=None)
@given(events=TICKS, reference=TICKS)
def test_it_is_optimal_transport(events: list[int], reference: list[int]) -> None:
    # forwards the surplus goes past the end, backwards before the beginning
    ways = [cheapest_transport(events, reference, rest) for rest in (K + 1, 0)]
    found = emd_map(one_pixel(events), one_pixel(reference), WINDOW)
    assert found[1, 1, 2] == pytest.approx(sum(ways) / (2 * K), abs=1e-12)
    assert found.sum() == found[1, 1, 2]


def plain_emd(events: Events, reference: Events) -> np.ndarray:
    """Equations (7) and (8) as they stand, on dense sequences (2, height, width, K)."""
    sequences = []
    for part in (reference, events):
        dense = np.zeros((2, WINDOW.height, WINDOW.width, K))
        for t, x, y, p in part.tolist():
            dense[p, y, x, -((5000 - t) // 1000) - 1] += 1
        sequences.append(dense)

    def one_way(e: np.ndarray, s: np.ndarray) -> np.ndarray:
        return np.abs(np.cumsum(s, -1) - np.cumsum(e, -1)).sum(-1) / K

    e, s = sequences
    return (one_way(e, s) + one_way(e[..., ::-1], s[..., ::-1])) / 2


@settings(max_examples=100, deadline=None)
@given(events=STREAMS, reference=STREAMS)
def test_the_equations_as_they_stand(events: Events, reference: Events) -> None:
    found, expected = emd_map(events, reference, WINDOW), plain_emd(events, reference)
    assert found == pytest.approx(expected, abs=1e-12)
    assert mean_emd(events, reference, WINDOW) == pytest.approx(expected.sum() / 12, abs=1e-12)


@settings(max_examples=100, deadline=None)
@given(
    events=STREAMS,
    reference=STREAMS,
    other=STREAMS,
    shift=st.integers(-(2**50), 2**50),
)
def test_a_distance(events: Events, reference: Events, other: Events, shift: int) -> None:
    found = emd_map(events, reference, WINDOW)
    assert (emd_map(reference, events, WINDOW) == found).all()
    assert (emd_map(events, events[::-1], WINDOW) == 0).all()
    detour = emd_map(events, other, WINDOW) + emd_map(other, reference, WINDOW)
    assert (found <= detour + 1e-12).all()

    # later, everything; and backwards: a tick's last stamp becomes its last again
    later = Window(4, 3, WINDOW.t_begin_us + shift, WINDOW.t_end_us + shift)
    moved = [
        make_events(part["t"] + shift, part["x"], part["y"], part["p"])
        for part in (events, reference)
    ]
    assert (emd_map(*moved, later) == found).all()
    mirror = WINDOW.t_begin_us + WINDOW.t_end_us + 1
    backwards = [
        make_events(mirror - part["t"], part["x"], part["y"], part["p"])
        for part in (events, reference)
    ]
    assert (emd_map(*backwards, WINDOW) == found).all()

    # events that both have change nothing
    joined = [join_events([part, other]) for part in (events, reference)]
    assert (emd_map(*joined, WINDOW) == found).all()


@settings(max_examples=60, deadline=None)
@given(events=STREAMS, reference=STREAMS)
def test_the_summary_under_a_swap(events: Events, reference: Events) -> None:
    window = (4, 3, 5000, 5000 + K * 1000)
    one, other = compare(events, reference, *window), compare(reference, events, *window)
    assert one.pairs == other.pairs
    assert str(one.recall) == str(other.precision)
    assert one.emd == other.emd
    assert one.count_loss == other.count_loss
    assert one.rate_maps.rmse_hz == other.rate_maps.rmse_hz
    assert one.spurious.events == one.events - one.pairs
    # nothing on a still pixel can have had a partner
    assert one.spurious.static_events <= one.spurious.events
    assert one.rate_maps.kl_nats >= 0
    if not np.isnan(one.rate_maps.correlation):
        assert one.rate_maps.correlation == pytest.approx(other.rate_maps.correlation)
        assert -1 <= one.rate_maps.correlation <= 1


@settings(max_examples=60, deadline=None)
@given(events=STREAMS.filter(len))
def test_a_stream_compared_with_itself(events: Events) -> None:
    found = compare(events, events, 4, 3, 5000, 5000 + K * 1000)
    assert (found.recall, found.precision, found.emd, found.count_loss) == (1, 1, 0, 0)
    assert (found.spurious.events, found.spurious.rate_hz) == (0, 0)
    assert (found.timing.median_us, found.timing.iqr_us, found.timing.median_abs_us) == (0, 0, 0)
    assert (found.rate_maps.rmse_hz, found.rate_maps.kl_nats) == (0, 0)
    assert found.count_ratio.all == 1


@settings(max_examples=60, deadline=None)
@given(events=STREAMS, delay_us=st.integers(-1500, 1500))
def test_a_late_stream_of_lone_events_is_late_by_that_much(events: Events, delay_us: int) -> None:
    # every event alone on its pixel, pixels three apart: only its own copy can be its partner
    _, alone = np.unique(events["y"] * 4 + events["x"], return_index=True)
    events = events[alone]
    reference = make_events(events["t"], events["x"] * 3, events["y"] * 3, events["p"])
    late = make_events(reference["t"] + delay_us, reference["x"], reference["y"], reference["p"])
    found = compare(late, reference, 12, 9, 0, 40_000)
    assert found.pairs == len(events)
    if len(events):
        assert found.timing.median_us == delay_us
        assert (found.timing.iqr_us, found.timing.median_abs_us) == (0, abs(delay_us))
