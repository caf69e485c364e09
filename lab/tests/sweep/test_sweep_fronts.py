"""Fronts of random records: nothing on one is dominated, everything off it is."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs_lab.sweep.pareto_front import ParetoPoint, pareto_front
from evs_lab.sweep.point_names import Label, overlap, place_labels
from evs_lab.sweep.record import SweepRecord

pytestmark = pytest.mark.property

RECORD = SweepRecord("a.xml", "still", "fast", "", "", {})

# few different values, so that there are many ties
pareto_point = st.builds(
    ParetoPoint,
    st.just(RECORD),
    st.sampled_from([0.1, 0.2, 0.5, 1.0, 2.0]) | st.floats(1e-4, 10.0),
    st.sampled_from([0.0, 0.1, 0.2, 0.3]) | st.floats(0.0, 1.0),
    st.sampled_from([0.0, 0.15]),
)


@given(st.lists(pareto_point, max_size=30))
def test_no_point_of_a_front_is_dominated_and_every_other_one_is(every: list[ParetoPoint]) -> None:
    found = pareto_front(every)
    assert bool(found) == bool(every)
    kept = {id(one) for one in found}
    for one, other in itertools.product(found, every):
        assert not other.dominates(one)
    for other in every:
        if id(other) not in kept:
            equal = any(
                (p.speed, p.visible_error) == (other.speed, other.visible_error) for p in found
            )
            assert equal or any(p.dominates(other) for p in found)
    # the fastest first, each more accurate than the one before
    for one, two in itertools.pairwise(found):
        assert one.speed > two.speed
        assert one.visible_error > two.visible_error


numbers = st.floats(0.0, 300.0)
label = st.builds(
    Label,
    st.tuples(numbers, numbers),
    st.tuples(st.floats(5.0, 90.0), st.just(14.0)),
    st.floats(5.0, 80.0),
)
box = st.builds(lambda x, y: (x, y, x + 8.0, y + 8.0), numbers, numbers)


@given(st.lists(label, max_size=25), st.lists(box, max_size=15))
def test_labels_stay_inside_and_touch_nothing(
    labels: list[Label], taken: list[tuple[float, float, float, float]]
) -> None:
    frame = (0.0, 0.0, 300.0, 300.0)
    boxes = place_labels(labels, taken, frame, 8.0)
    assert len(boxes) == len(labels)
    placed = [b for b in boxes if b is not None]
    for left, top, right, bottom in placed:
        assert left >= 0.0
        assert top >= 0.0
        assert right <= 300.0
        assert bottom <= 300.0
    for one, two in itertools.combinations(placed, 2):
        assert not overlap(one, two)
    for one, two in itertools.product(placed, taken):
        assert not overlap(one, two)
    for asked, b in zip(labels, boxes, strict=True):
        if b is not None:
            assert abs(b[2] - b[0] - asked.size[0]) < 1e-9
            assert abs(b[3] - b[1] - asked.size[1]) < 1e-9
            nearest = [
                min(max(p, lo), hi) for p, lo, hi in zip(asked.at, b[:2], b[2:], strict=True)
            ]
            away = max(abs(p - n) for p, n in zip(asked.at, nearest, strict=True))
            assert away <= asked.reach_px + 1e-6
    # alone and well inside there is always room
    alone = Label((150.0, 150.0), (60.0, 14.0), 8.0)
    assert place_labels([alone], [], frame, 8.0) != [None]
