"""Records of a sweep: whatever can be said comes back from its line."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.msgs import EvsError
from evs_lab.sweep.record import (
    CAMERAS,
    KINDS,
    STAGES,
    Accuracy,
    ConfidenceInterval,
    Speed,
    SweepRecord,
    merged,
)

pytestmark = pytest.mark.property

NUMBER = st.floats(allow_nan=False, allow_infinity=False)
INTERVAL = st.builds(ConfidenceInterval, NUMBER, NUMBER, NUMBER, st.integers(0, 1000))
SPEED = st.builds(
    Speed,
    INTERVAL,
    INTERVAL,
    INTERVAL,
    st.dictionaries(st.sampled_from(STAGES), INTERVAL),
    NUMBER,
    st.integers(0, 10**6),
)
ERROR = st.builds(Accuracy, *[NUMBER] * 10)
SETTING = st.one_of(st.text(), st.integers(), NUMBER, st.booleans())
RECORD = st.builds(
    SweepRecord,
    st.text(),
    st.sampled_from(CAMERAS),
    st.text(),
    st.text(),
    st.text(),
    st.dictionaries(st.text(), SETTING),
    st.sampled_from(KINDS),
    st.none() | SPEED,
    st.none() | ERROR,
    st.text(),
)


@given(RECORD)
def test_record_comes_back_from_its_line(record: SweepRecord) -> None:
    line = record.to_json()
    assert "\n" not in line
    assert SweepRecord.from_json(line) == record


def test_undefined_value_is_null_and_comes_back() -> None:
    error = Accuracy(1.0, 0.1, math.nan, *[0.5] * 7)
    line = SweepRecord("s", "still", "fast", "", "", {}, error=error).to_json()
    assert json.loads(line)["error"]["recall"] is None
    back = SweepRecord.from_json(line).error
    assert back is not None
    assert math.isnan(back.recall)
    assert back.emd == 1.0


GOOD = json.loads(
    SweepRecord("s", "pan", "fast", "", "", {}, error=Accuracy(*[0.5] * 10)).to_json()
)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kind": "others"}, "kind"),
        ({"camera": "spin"}, "camera"),
        ({"sped": 1}, "speed"),
        ({"speed": {"ticks": 3}}, "missing"),
        ({"speed": 3}, "speed is not a table"),
        ({"settings": {"render.spp": [1]}}, "settings.render.spp"),
        ({"error": {**GOOD["error"], "emd": "big"}}, "error.emd"),
        ({"scene": 3}, "scene is not a text"),
    ],
)
def test_what_is_no_record_is_refused_in_one_line(change: dict[str, Any], said: str) -> None:
    with pytest.raises(EvsError, match=said) as found:
        SweepRecord.from_json(json.dumps({**GOOD, **change}))
    assert "\n" not in str(found.value)


def test_torn_line_is_refused() -> None:
    with pytest.raises(EvsError, match="delete the line"):
        SweepRecord.from_json(json.dumps(GOOD)[:-5])


@given(RECORD, SPEED, ERROR)
def test_speed_and_error_of_a_point_are_put_together(
    record: SweepRecord, speed: Speed, error: Accuracy
) -> None:
    bare = SweepRecord(**{**vars(record), "speed": None, "error": None})
    fast = SweepRecord(**{**vars(record), "speed": speed, "error": None})
    near = SweepRecord(**{**vars(record), "speed": None, "error": error})
    both = SweepRecord(**{**vars(record), "speed": speed, "error": error})
    assert merged([bare, fast, near]) == [both] == merged([near, fast])
    # of another configuration: nothing of it is kept
    other = SweepRecord(**{**vars(near), "digest": record.digest + "x"})
    assert merged([fast, other]) == [other]
