"""Whatever events a camera gives, every format gives them back, and so do its packets."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.drivers.files import packets, read, recorder_for, repair, summary
from evs.msgs import EventPacket, Events, StreamInfo, join_events, make_events

pytestmark = pytest.mark.property

# what XML can carry: no control characters, no lone surrogates; a carriage return becomes \n
NAMES = st.text(
    st.characters(exclude_categories=("Cs", "Cc"), exclude_characters="\ufffe\uffff"), max_size=20
)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)
TABLES = st.dictionaries(st.text(max_size=9), PLAIN, max_size=4)


@st.composite
def streams(draw: st.DrawFn, shortest_us: int) -> StreamInfo:
    return StreamInfo(
        width=draw(st.integers(1, 1 << 15)),
        height=draw(st.integers(1, 1 << 15)),
        camera=draw(NAMES),
        sensor=draw(NAMES),
        tick_us=draw(st.integers(shortest_us, 10**7)),
        seed=draw(st.integers()),
        versions=draw(st.dictionaries(NAMES, NAMES, max_size=3)),
        config=draw(TABLES),
        camera_info=draw(TABLES),
    )


@st.composite
def ticks(draw: st.DrawFn, stream: StreamInfo) -> list[Events]:
    """Events of some ticks in their order, empty ones too."""
    number = draw(st.integers(-(10**6), 2**61 // stream.tick_us))
    found = []
    for _ in range(draw(st.integers(0, 5))):
        number += draw(st.integers(1, 3))
        count = draw(st.sampled_from([0, 1, 2, 30]))
        random = np.random.default_rng(draw(st.integers(0, 2**32)))
        end_us = number * stream.tick_us
        t = np.sort(random.integers(end_us - stream.tick_us + 1, end_us + 1, count))
        x, y = random.integers(0, stream.width, count), random.integers(0, stream.height, count)
        found.append(make_events(t, x, y, random.integers(0, 2, count)))
    return found


@pytest.mark.parametrize(
    ("name", "compression"),
    [
        ("a.aedat4", "lz4"),
        pytest.param("a.aedat4", "none", marks=pytest.mark.slow),
        pytest.param("a.aedat4", "zstd", marks=pytest.mark.slow),
        ("a.npz", "lz4"),
    ],
)
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_what_goes_in_comes_out(name: str, compression: str, data: st.DataObject) -> None:
    # NPZ has no packets of its own: a stream of 1 us, as of real sensors, is read in parts of 1 ms
    stream = data.draw(streams(shortest_us=2 if name.endswith("npz") else 1))
    parts = data.draw(ticks(stream))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        sink = recorder_for(path, compression)
        sink.open([stream])
        for seq, events in enumerate(parts):
            sink.write(EventPacket(seq, 0, 0, stream.width, stream.height, events, stream.camera))
        said = sink.close()
        recording, played = read(path), list(packets(path))
        told, needed = summary(path), repair(path).needed
    whole = join_events(parts)
    assert recording.tobytes() == whole.tobytes()
    assert recording.stream == stream
    full = [events for events in parts if len(events)]
    assert [packet.events.tobytes() for packet in played] == [part.tobytes() for part in full]
    for packet in played:
        # one tick each: (time_base, time_end] on the tick grid
        assert packet.time_end_us - packet.time_base_us == stream.tick_us
        assert packet.time_base_us < packet.events["t"][0]
        assert packet.events["t"][-1] <= packet.time_end_us
    assert said["events"] == told.events == told.on + told.off == len(whole)
    assert said["packets"] == told.packets == len(full)
    assert said["bytes"] == told.size
    assert not needed
