"""All metrics in one call, and the window they look at."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from evs.msgs import EVENT_DTYPE, EvsError, empty_events, make_events
from evs_lab.metrics import Window, compare

REFERENCE = make_events([1000, 2000, 3000, 9000], [1, 1, 2, 7], [1, 2, 2, 7], [1, 0, 1, 1])
EVENTS = make_events([1200, 2100, 8000, 9900], [1, 1, 4, 0], [1, 2, 4, 0], [1, 0, 0, 1])


def test_every_number_by_hand() -> None:
    found = compare(EVENTS, REFERENCE, 8, 8, 0, 10_000)
    assert (found.events, found.reference_events, found.pairs) == (4, 4, 2)
    assert (found.recall, found.precision) == (0.5, 0.5)
    assert (found.timing.pairs, found.timing.median_us, found.timing.iqr_us) == (2, 150.0, 50.0)
    # ghosts at (4, 4), on a still pixel, and at (0, 0), one pixel off the event at (1, 1)
    assert found.spurious.events == 2
    assert found.spurious.rate_hz == pytest.approx(2 / 64 / 0.01)
    # busy with margin: 3 x 3 at (1, 1), 3 x 3 at (1, 2), 3 x 3 at (2, 2) make 15; (7, 7) makes 4
    assert found.spurious.static_px == 64 - 15 - 4
    assert found.spurious.static_events == 1
    assert (found.count_ratio.on, found.count_ratio.off, found.count_ratio.all) == (2 / 3, 2.0, 1.0)
    assert found.count_loss == 4 / 64
    assert found.rate_maps.rmse_hz == pytest.approx(100 * math.sqrt(4 / 64))
    # (1, 1): ticks 2 and 1; (1, 2): 3 and 2; four pixels with one event on one side
    assert found.emd == pytest.approx((1 / 10 + 1 / 10 + 4 * 11 / 20) / 64)


def test_definitions_go_with_the_numbers() -> None:
    found = compare(EVENTS, REFERENCE, 8, 8, 0, 10_000, tolerance_us=150, tolerance_px=0, tick_us=5)
    assert (found.tolerance_us, found.tolerance_px, found.tick_us) == (150, 0, 5)
    assert found.window == Window(8, 8, 0, 10_000)
    assert found.pairs == 1
    assert found.spurious.static_px == 64 - 4
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.recall = 1.0  # type: ignore[misc]


def test_a_mask_of_ones_own() -> None:
    corner = np.zeros((8, 8), np.bool_)
    corner[0, 0] = True
    found = compare(EVENTS, REFERENCE, 8, 8, 0, 10_000, static=corner)
    assert (found.spurious.static_px, found.spurious.static_events) == (1, 1)


def test_only_the_window_counts() -> None:
    # 1000 and 9900 are out, 9000 is in; 1200 finds another partner: 3000, one pixel away
    found = compare(EVENTS, REFERENCE, 8, 8, 1000, 9000)
    assert (found.events, found.reference_events, found.pairs) == (3, 3, 2)
    assert found.timing.median_us == (100 - 1800) / 2


def test_order_does_not_matter() -> None:
    found = compare(EVENTS[::-1], REFERENCE[[2, 0, 3, 1]], 8, 8, 0, 10_000)
    assert found == compare(EVENTS, REFERENCE, 8, 8, 0, 10_000)


def numbers(value: Any) -> list[Any]:
    """The leaves of nested dicts."""
    if isinstance(value, dict):
        return [leaf for inner in value.values() for leaf in numbers(inner)]
    return [value]


def test_a_report_is_strict_json() -> None:
    found = compare(EVENTS, REFERENCE, 8, 8, np.int64(0), np.int64(10_000), tick_us=np.int32(1000))
    report = found.to_dict()
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["recall"] == 0.5
    assert report["window"] == {"width": 8, "height": 8, "t_begin_us": 0, "t_end_us": 10_000}
    assert report["timing"]["median_us"] == 150.0
    assert {type(leaf) for leaf in numbers(report)} == {int, float}
    assert list(report) == [field.name for field in dataclasses.fields(found)]


def test_what_is_not_defined_is_null() -> None:
    report = compare(empty_events(), empty_events(), 8, 8, 0, 10_000).to_dict()
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert (report["recall"], report["precision"]) == (None, None)
    assert set(report["timing"].values()) == {0, None}
    assert set(report["count_ratio"].values()) == {None}
    assert report["emd"] == report["spurious"]["rate_hz"] == 0
    # a reference that is busy everywhere leaves no still pixel
    busy = make_events([1] * 4, [0, 1, 0, 1], [0, 0, 1, 1], [1] * 4)
    assert compare(busy, busy, 2, 2, 0, 1000).to_dict()["spurious"]["static_rate_hz"] is None


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"width": 7}, "an event has x = 7, outside 7 x 8 px"),
        ({"height": 7}, "an event has y = 7, outside 8 x 7 px"),
        ({"width": 0}, "window.width is 0"),
        ({"height": 8.0}, "window.height is 8.0; give a whole number"),
        ({"width": True}, "window.width is True; give a whole number"),
        ({"width": 40_000}, "give 1 ... 32767 px"),
        ({"t_end_us": 0}, "give t_end_us > t_begin_us"),
        ({"t_end_us": 2**61}, "give stamps in us"),
        ({"t_end_us": 10_001}, "move t_end_us back by 1 us"),
        ({"tick_us": 0}, "tick_us is 0; give 1 or more"),
        ({"tolerance_us": -1}, "tolerance_us is -1"),
        ({"static": np.ones((8, 7), np.bool_)}, "static pixels"),
        ({"events": [1, 2]}, "events are no events"),
        ({"reference": np.zeros((1, 1), EVENT_DTYPE)}, "reference have 2 dimensions"),
        ({"events": make_events([1], [-1], [0], [1])}, "events: an event has x = -1"),
        ({"reference": make_events([1], [0], [0], [2])}, "reference: an event has polarity 2"),
        ({"events": make_events([1], [0], [0], [-1])}, "write 1 for ON and 0 for OFF"),
    ],
)
def test_bad_input_is_one_line_with_the_fix(changed: dict[str, Any], says: str) -> None:
    arguments = {"width": 8, "height": 8, "t_begin_us": 0, "t_end_us": 10_000}
    arguments |= {"events": EVENTS, "reference": REFERENCE} | changed
    with pytest.raises(EvsError) as caught:
        compare(**arguments)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_lies_outside_the_window_is_not_looked_at() -> None:
    odd = make_events([0, 20_000], [-1, 900], [0, 0], [7, 7])
    assert compare(odd, REFERENCE, 8, 8, 0, 10_000).events == 0
