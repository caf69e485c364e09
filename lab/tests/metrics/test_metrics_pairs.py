"""Pairs of any two streams: as many as brute force finds, and the same under every symmetry."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.msgs import Events, make_events
from evs_lab.metrics import Matching, match_events
from evs_lab.metrics.matching import enlarge_matching

pytestmark = pytest.mark.property

EVENT = st.tuples(
    st.integers(0, 12_000) | st.integers(0, 12).map(lambda k: k * 1000),
    st.integers(0, 4),
    st.integers(0, 2),
    st.integers(0, 1),
)


def streams(most: int) -> st.SearchStrategy[Events]:
    return st.lists(EVENT, max_size=most).map(
        lambda rows: make_events(*np.array(rows, np.int64).reshape(-1, 4).T)
    )


TOLERANCES = st.tuples(st.integers(0, 4000), st.integers(0, 2))


def allowed(events: Events, reference: Events, tolerance_us: int, tolerance_px: int) -> np.ndarray:
    """(n, m) bool, straight from the definition."""
    apart = {
        name: np.abs(events[name].astype(np.int64)[:, None] - reference[name].astype(np.int64))
        for name in ("t", "x", "y", "p")
    }
    near = (apart["x"] <= tolerance_px) & (apart["y"] <= tolerance_px)
    return near & (apart["t"] <= tolerance_us) & (apart["p"] == 0)


def brute_force(may: np.ndarray) -> int:
    """Size of the largest matching: every event with every free partner, and with none."""
    options = [np.flatnonzero(row).tolist() for row in may]

    @cache
    def most(event: int, taken: int) -> int:
        if event == len(options):
            return 0
        best = most(event + 1, taken)
        for partner in options[event]:
            if not taken >> partner & 1:
                best = max(best, 1 + most(event + 1, taken | 1 << partner))
        return best

    return most(0, 0)


def check_one_to_one(found: Matching, may: np.ndarray) -> None:
    assert len(set(found.event_index.tolist())) == found.pairs
    assert len(set(found.reference_index.tolist())) == found.pairs
    assert (np.diff(found.event_index) > 0).all()
    assert may[found.event_index, found.reference_index].all()


@settings(max_examples=300, deadline=None)
@given(events=streams(9), reference=streams(9), tolerances=TOLERANCES)
def test_as_many_pairs_as_brute_force(
    events: Events, reference: Events, tolerances: tuple[int, int]
) -> None:
    found = match_events(events, reference, *tolerances)
    may = allowed(events, reference, *tolerances)
    check_one_to_one(found, may)
    assert found.pairs == brute_force(may)


@settings(max_examples=200, deadline=None)
@given(
    may=st.integers(1, 9).flatmap(
        lambda m: st.lists(st.lists(st.booleans(), min_size=m, max_size=m), min_size=1, max_size=9)
    )
)
def test_any_graph_from_an_empty_matching(may: list[list[bool]]) -> None:
    # starting from nothing, every pair is the work of augmenting paths
    table = np.array(may)
    left, right = np.nonzero(table)
    starts = np.searchsorted(left, np.arange(len(table) + 1))
    of_left, of_right = np.full(len(table), -1), np.full(table.shape[1], -1)
    enlarge_matching(starts, right, of_left, of_right)
    matched = np.flatnonzero(of_left >= 0)
    assert len(matched) == brute_force(table)
    assert table[matched, of_left[matched]].all()
    assert (of_right[of_left[matched]] == matched).all()
    assert np.count_nonzero(of_right >= 0) == len(matched)


def kuhn(may: np.ndarray) -> int:
    """Size of the largest matching by one augmenting path after another."""
    owner = [-1] * may.shape[1]

    def place(event: int, tried: set[int]) -> bool:
        for partner in np.flatnonzero(may[event]).tolist():
            if partner not in tried:
                tried.add(partner)
                if owner[partner] < 0 or place(owner[partner], tried):
                    owner[partner] = event
                    return True
        return False

    return sum(place(event, set()) for event in range(len(may)))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.floats(0.1, 1.0))
def test_crowded_streams_too(seed: int, share: float) -> None:
    generator = np.random.default_rng(seed)
    events, reference = (
        make_events(
            np.sort(generator.integers(0, 40_000, n)),
            *(generator.integers(0, side, n) for side in (6, 4, 2)),
        )
        for n in (150, int(150 * share))
    )
    found = match_events(events, reference)
    may = allowed(events, reference, 3000, 1)
    check_one_to_one(found, may)
    assert found.pairs == kuhn(may)


@settings(max_examples=100, deadline=None)
@given(
    events=streams(25),
    reference=streams(25),
    tolerances=TOLERANCES,
    shift=st.tuples(st.integers(-(2**50), 2**50), st.integers(-900, 900), st.integers(-900, 900)),
    seed=st.integers(0, 2**32),
)
def test_symmetries(
    events: Events,
    reference: Events,
    tolerances: tuple[int, int],
    shift: tuple[int, int, int],
    seed: int,
) -> None:
    found = match_events(events, reference, *tolerances)
    swapped = match_events(reference, events, *tolerances)
    assert swapped.pairs == found.pairs

    # moved in time and space: the very same pairs
    t, x, y = shift
    moved = [
        make_events(part["t"] + t, part["x"] + x, part["y"] + y, part["p"])
        for part in (events, reference)
    ]
    same = match_events(*moved, *tolerances)
    assert (same.event_index == found.event_index).all()
    assert (same.reference_index == found.reference_index).all()

    # shuffled, mirrored in time, and in space: as many pairs
    generator = np.random.default_rng(seed)
    mixed = [part[generator.permutation(len(part))] for part in (events, reference)]
    assert match_events(*mixed, *tolerances).pairs == found.pairs
    mirrored = [
        make_events(-part["t"], -part["y"], part["x"], 1 - part["p"])
        for part in (events, reference)
    ]
    assert match_events(*mirrored, *tolerances).pairs == found.pairs


@settings(max_examples=60, deadline=None)
@given(events=streams(25), tolerances=TOLERANCES)
def test_a_stream_matches_itself_without_error(events: Events, tolerances: tuple[int, int]) -> None:
    found = match_events(events, events, *tolerances)
    assert found.pairs == len(events)
    assert (events[found.event_index] == events[found.reference_index]).all()
