"""Any events come back from RAW, DAT, HDF5 and bags as they were, whatever the packets."""

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
    "rosbag2": (".mcap", 32_767, "libcaer"),
    "rosbag2 evt3": (".mcap", 2048, "evt3"),
    "rosbag2 dvs": (".mcap", 32_767, "dvs"),
    "rosbag1": (".bag", 32_767, "dvs"),
    "rosbag1 mono": (".bag", 32_767, "mono"),
}


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
