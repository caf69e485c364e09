"""Any events come back from RAW, DAT, HDF5 and bags as they were, whatever the packets."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.drivers import files
from evs.msgs import EventPacket, Events, StreamInfo, join_events, make_events

FORMATS = {
    "evt3": (".raw", 2048, ""),
    "evt2": (".raw", 2048, ""),
    "evt21": (".raw", 2048, ""),
    "dat": (".dat", 16_383, ""),
    "hdf5": (".h5", 32_767, ""),
    "rosbag2": (".mcap", 32_767, "libcaer"),
    "rosbag2 evt3": (".mcap", 2048, "evt3"),
    "rosbag2 dvs": (".mcap", 32_767, "dvs"),
    "rosbag1": (".bag", 32_767, "dvs"),
    "rosbag1 mono": (".bag", 32_767, "mono"),
}


@st.composite
def streams(draw: st.DrawFn, side: int, kind: str) -> tuple[StreamInfo, list[Events]]:
    """A stream and its packets: sorted, near a stamp at which something wraps, or far from it."""
    stream = StreamInfo(
        draw(st.integers(1, side)),
        draw(st.integers(1, side)),
        camera=draw(st.text(min_size=1, max_size=8)),
        tick_us=draw(st.sampled_from([1, 1000, 123_456])),
        seed=draw(st.integers(0, 2**64)),
        config={draw(st.text(max_size=4)): draw(st.integers() | st.text(max_size=5) | st.none())},
    )
    edges = [0, 999, 2**24, 2**31, 2**32, 2**33, 2**34 - 1_000_000]
    at = draw(st.sampled_from(edges[: 4 if kind == "dat" else None]))
    at = max(0, at - draw(st.integers(1, 2000)))
    # a mono packet is 4.29 s long at most
    step = 300_000 if kind.endswith("mono") else 2**29
    packets = []
    for _ in range(draw(st.integers(0, 4))):
        steps = draw(st.lists(st.integers(0, 700) | st.integers(0, step), max_size=12))
        t = at + np.cumsum(np.array(steps, np.int64))
        at = int(t[-1]) if len(t) else at
        seed = np.random.default_rng(draw(st.integers(0, 2**32)))
        x, y = seed.integers(0, stream.width, len(t)), seed.integers(0, stream.height, len(t))
        packets.append(make_events(t, x, y, seed.integers(0, 2, len(t))))
    return stream, packets


@pytest.mark.parametrize("kind", FORMATS)
@settings(max_examples=15, deadline=5000)
@given(data=st.data())
def test_events_come_back_as_they_were(kind: str, data: st.DataObject) -> None:
    suffix, side, encoding = FORMATS[kind]
    stream, packets = data.draw(streams(side, kind))
    name, options = kind.split()[0], {"encoding": encoding} if encoding else {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"a{suffix}")
        sink = files.recorder_for(path, kind=name, **options)
        sink.open([stream])
        for seq, events in enumerate(packets):
            sink.write(EventPacket(seq, 0, 0, stream.width, stream.height, events, stream.camera))
        report = sink.close()
        recording, whole = files.read(path), join_events(packets)
        assert recording.tobytes() == whole.tobytes()
        assert (report["events"], report["bytes"]) == (len(whole), path.stat().st_size)
        assert recording.stream == stream
        found = files.summary(path)
        assert (found.format, found.torn_at, found.damaged_packets) == (name, None, 0)
        assert found.backwards == ""
