"""Any events come back as they were from every format that holds them, whatever the packets."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.drivers import files
from evs.msgs import EventPacket, join_events
from reference.streams import EDGES_US, streams

pytestmark = pytest.mark.property

FORMATS = {
    "evt3": (".raw", 2048, ""),
    "evt2": (".raw", 2048, ""),
    "evt21": (".raw", 2048, ""),
    "dat": (".dat", 16_383, ""),
    "hdf5": (".h5", 32_767, ""),
    "metavision": (".hdf5", 2048, ""),
    "rosbag2": (".mcap", 32_767, "libcaer"),
    "rosbag2 evt3": (".mcap", 2048, "evt3"),
    "rosbag2 dvs": (".mcap", 32_767, "dvs"),
    "rosbag1": (".bag", 32_767, "dvs"),
    "rosbag1 mono": (".bag", 32_767, "mono"),
}

APPENDED = {
    "aedat2": (".aedat", 1024, 512),
    "aedat3": (".aedat3", 32_768, 32_768),
    "csv": (".csv", 32_768, 32_768),
}
"""formats of which a recording may be several files: ending, width, height"""


@pytest.mark.parametrize("kind", FORMATS)
@settings(max_examples=15, deadline=5000)
@given(data=st.data())
def test_events_come_back_as_they_were(kind: str, data: st.DataObject) -> None:
    suffix, side, encoding = FORMATS[kind]
    # DAT does not tell a wrap before its first event; a mono packet is 4.29 s long at most
    edges = [edge for edge in EDGES_US if kind != "dat" or edge < 2**32]
    step_us = 300_000 if kind.endswith("mono") else 2**29
    stream, packets = data.draw(streams(side, side, edges, step_us))
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


@pytest.mark.slow
@pytest.mark.parametrize("kind", APPENDED)
@settings(max_examples=60, deadline=5000)
@given(data=st.data())
def test_events_come_back_from_each_file(kind: str, data: st.DataObject) -> None:
    suffix, width, height = APPENDED[kind]
    stream, packets = data.draw(streams(width, height))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"a{suffix}")
        sink = files.recorder_for(path)
        sink.open([stream])
        for seq, events in enumerate(packets):
            sink.write(EventPacket(seq, 0, 0, stream.width, stream.height, events, stream.camera))
        report = sink.close()
        made = [one for one in Path(folder).iterdir() if one.suffix != ".json"]
        written = sorted(made, key=lambda one: (one != path, one.name))
        wanted = [event for events in packets for event in events.tolist()]
        got = [files.read(one, single=True) for one in written]
        assert [event for events in got for event in events.tolist()] == wanted
        assert report["events"] == len(wanted)
        assert report["bytes"] == sum(one.stat().st_size for one in written)
        assert {one.stream == stream for one in got} == {True}
        for one in written:
            found = files.summary(one, single=True)
            assert (found.torn_at, found.damaged_packets, found.backwards) == (None, 0, "")
            if not found.events:
                continue
            # a killed recorder leaves any part of the last packet
            with one.open("r+b") as file:
                file.truncate(one.stat().st_size - data.draw(st.integers(1, 7)))
            assert found.events - 1 <= files.summary(one, single=True).events <= found.events
