"""Any events come back as they were from every format that holds them, whatever the packets."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.drivers import files
from evs.msgs import EventPacket
from reference.streams import streams

pytestmark = pytest.mark.property

FORMATS = {
    "aedat2": (".aedat", 1024, 512),
    "aedat3": (".aedat3", 32_768, 32_768),
    "csv": (".csv", 32_768, 32_768),
}


@pytest.mark.parametrize("kind", FORMATS)
@settings(max_examples=60, deadline=5000)
@given(data=st.data())
def test_events_come_back_as_they_were(kind: str, data: st.DataObject) -> None:
    suffix, width, height = FORMATS[kind]
    stream, packets = data.draw(streams(width, height))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"a{suffix}")
        sink = files.recorder_for(path)
        sink.open([stream])
        for seq, events in enumerate(packets):
            sink.write(EventPacket(seq, 0, 0, stream.width, stream.height, events, stream.camera))
        report = sink.close()
        written = sorted(Path(folder).iterdir(), key=lambda one: (one != path, one.name))
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
