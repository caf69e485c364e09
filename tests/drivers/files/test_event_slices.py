"""EventSlices: every event in the slice that its time or its number says, as views."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import evs
from evs.drivers.files import recorder_for
from evs.drivers.files.reading import Recording
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events

STREAM = StreamInfo(30, 20, "left")


def recording(stamps: Any) -> Recording:
    t = np.sort(np.asarray(stamps, np.int64))
    return Recording.of(make_events(t, t % 30, t % 20, t % 2), STREAM)


@given(
    stamps=st.lists(st.integers(0, 500), max_size=60),
    size=st.integers(1, 120),
    step=st.none() | st.integers(1, 150),
    by_time=st.booleans(),
)
@pytest.mark.property
def test_slices_are_what_masks_say(
    stamps: list[int], size: int, step: int | None, by_time: bool
) -> None:
    events = recording(stamps)
    slices = evs.EventSlices(events, step=step, **{"span_us" if by_time else "count": size})
    step = step or size
    expected = []
    if by_time and len(events):
        begin = int(events["t"][0])
        while begin + size <= events["t"][-1]:
            expected.append(events[(events["t"] >= begin) & (events["t"] < begin + size)])
            begin += step
    elif not by_time:
        begin = 0
        while begin + size <= len(events):
            expected.append(events[begin : begin + size])
            begin += step
    assert len(slices) == len(expected)
    for found, wanted in zip(slices, expected, strict=True):
        assert np.array_equal(found, wanted)
    for place in range(-len(slices), len(slices)):
        part, (begin, end) = slices.events(place)
        assert np.array_equal(part, expected[place])
        assert begin <= end
        if len(part):
            assert np.shares_memory(part, np.asarray(events))
    shares = [one for worker in range(3) for one in slices.part(worker, 3)]
    assert sum(len(one) for one in shares) == sum(len(one) for one in expected)


def test_several_recordings_and_encoders(tmp_path: Path) -> None:
    """Files and arrays; no slice spans two; samples as a learner takes them."""
    for name, last in (("a", 95), ("b", 45)):
        sink = recorder_for(tmp_path / f"{name}.npz")
        sink.open([STREAM])
        t = np.arange(1, last)
        sink.write(EventPacket(0, 0, 1000, 30, 20, make_events(t, t % 30, t % 20, t % 2), "left"))
        sink.close()
    files = [str(tmp_path / "a.npz"), tmp_path / "b.npz"]
    slices = evs.EventSlices(
        files,
        span_us=20,
        encode=lambda events, interval: evs.voxel_grid(events, 3, (30, 20), interval),
    )
    assert len(slices) == 4 + 2
    assert [slices.events(place)[1][0] for place in range(6)] == [1, 21, 41, 61, 1, 21]
    for place in range(6):
        events, interval = slices.events(place)
        assert slices[place].shape == (3, 20, 30)
        assert np.array_equal(slices[place], evs.voxel_grid(events, 3, (30, 20), interval))
    assert len(slices[1:4]) == 3
    assert [slices.source(place) for place in (0, 3, 4, -1)] == [0, 0, 1, 1]
    plain = evs.EventSlices([*files, recording(range(300))], count=50, step=25)
    assert len(plain) == 2 + 0 + 11
    # as a worker of a loader that is started anew gets it
    again = pickle.loads(pickle.dumps(plain))
    assert np.array_equal(again[5], plain[5])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give either span_us"),
        ({"span_us": 10, "count": 10}, "give either span_us"),
        ({"span_us": 0}, "span_us is 0; give 1 or more"),
        ({"count": 5, "step": -1}, "step is -1; give 1 or more"),
        ({"count": 2.5}, "count is 2.5; give a whole number"),
    ],
)
def test_what_cannot_be_is_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(EvsError, match=message):
        evs.EventSlices(recording(range(100)), **options)


def test_unix_time_makes_no_more_slices() -> None:
    stamps = np.arange(0, 150_000, 100)
    slices = evs.EventSlices(recording(1_690_000_000_000_000 + stamps), span_us=50_000)
    assert [len(one) for one in slices] == [500, 500]
    assert slices.events(1)[1] == (1_690_000_000_050_000, 1_690_000_000_100_000)


def test_ends_and_disorder() -> None:
    slices = evs.EventSlices(recording(range(100)), count=10)
    for place in (10, -11):
        with pytest.raises(IndexError, match=f"slice {place} of 10"):
            slices[place]
    assert len(evs.EventSlices(recording([]), span_us=5)) == 0
    backwards = recording(range(100))[::-1]
    with pytest.raises(EvsError, match="not in order of time"):
        evs.EventSlices(backwards, span_us=5)
