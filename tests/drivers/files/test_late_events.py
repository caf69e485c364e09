"""Events that come late, by up to a second: every reader sorts and counts them."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from evs.drivers import files
from evs.drivers.files.aedat4 import layout
from evs.drivers.files.bags.messages import array_bytes
from evs.drivers.files.integrity import BackwardsWarning, IntegrityReport
from evs.drivers.files.time_order import MAX_REORDER_EVENTS, EventSorter, sort_events
from evs.launch.main import main
from evs.msgs import Events, StreamInfo, join_events, make_events

COUNT, LATE = 6000, (2500, 2501, 4700)
PACKETS = 12


def recorded() -> Events:
    """As recorded: 3 s, three events .999 s late."""
    rng = np.random.default_rng(7)
    t = np.arange(1, COUNT + 1) * 500
    t[list(LATE)] -= 999_000
    x, y = rng.integers(0, 60, COUNT), rng.integers(0, 40, COUNT)
    return make_events(t, x, y, rng.integers(0, 2, COUNT))


def aedat4(path: Path, events: Events) -> None:
    xml = (
        '<dv version="2.0"><node name="outInfo"><node name="0"><attr key="typeIdentifier">EVTS'
        '</attr><node name="info"><attr key="sizeX">64</attr><attr key="sizeY">48</attr></node>'
        "</node></node></dv>"
    )
    bodies = [layout.events_body(part) for part in np.split(events, PACKETS)]
    packets = b"".join(layout.PACKET_HEADER.pack(0, len(body)) + body for body in bodies)
    path.write_bytes(layout.MAGIC + layout.io_header(0, xml) + packets)


def aedat3(path: Path, events: Events) -> None:
    out = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DVS128\r\n#!END-HEADER\r\n"
    for part in np.split(events, PACKETS):
        out += struct.pack("<HhiiiIii", 1, 1, 8, 4, 0, *[len(part)] * 3)
        for t, x, y, p in part.tolist():
            out += struct.pack("<Ii", x << 17 | y << 2 | p << 1 | 1, t)
    path.write_bytes(out)


def aedat2(path: Path, events: Events) -> None:
    words = (
        struct.pack(">Ii", (127 - y) << 8 | (127 - x) << 1 | 1 - p, t)
        for t, x, y, p in events.tolist()
    )
    head = b"#!AER-DAT2.0\r\n# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n"
    path.write_bytes(head + b"".join(words))


def evt2(path: Path, events: Events) -> None:
    words = (
        struct.pack("<II", 8 << 28 | t >> 6, p << 28 | (t & 63) << 22 | x << 11 | y)
        for t, x, y, p in events.tolist()
    )
    path.write_bytes(b"% evt 2.0\n% geometry 64x48\n% end\n" + b"".join(words))


def dat(path: Path, events: Events) -> None:
    rows = (struct.pack("<II", t, x | y << 14 | p << 28) for t, x, y, p in events.tolist())
    head = b"% Version 2\n% Width 64\n% Height 48\n"
    path.write_bytes(head + bytes([0x0C, 8]) + b"".join(rows))


def bag(path: Path, events: Events) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "dvs_msgs/msg/EventArray"
    store.register(get_types_from_msg("uint8 nothing", kind))
    with rosbag1.Writer(path) as writer:
        topic = writer.add_connection("/dvs/events", kind, typestore=store)
        for k, part in enumerate(np.split(events, PACKETS)):
            writer.write(topic, k, array_bytes(part, 1, k, "dvs", 48, 64))


MADE: dict[str, Callable[[Path, Events], None]] = {
    "a.aedat4": aedat4,
    "a.aedat3": aedat3,
    "a.aedat": aedat2,
    "a.raw": evt2,
    "a.dat": dat,
    "a.bag": bag,
}


@pytest.mark.parametrize("name", MADE)
def test_late_events_are_sorted_and_counted_everywhere(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    events = recorded()
    MADE[name](path, events)
    wanted = sort_events(events)
    said = "3 time stamps ran backwards and were sorted"
    with pytest.warns(BackwardsWarning, match=said):
        assert files.read(path).tobytes() == wanted.tobytes()
    found = files.summary(path)
    assert (found.events, found.backwards.partition(";")[0]) == (COUNT, said)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = files.convert(path, tmp_path / "b.evt3", "evt3")
        parts = list(files.packets(path))
        assert main(["play", str(path), "--fast", "sink.0.type=csv",
                     f"sink.0.file={tmp_path / 'c.csv'}"]) == 0  # fmt: skip
    assert files.read(tmp_path / "c.csv").tobytes() == wanted.tobytes()
    assert done.events == COUNT
    (tmp_path / "b.evt3").rename(tmp_path / "b.raw")
    assert files.read(tmp_path / "b.raw").tobytes() == wanted.tobytes()
    stamps = np.concatenate([part.events["t"] for part in parts])
    assert (np.diff(stamps) >= 0).all()


@pytest.mark.parametrize("chunk", [1, 37, 1000])
def test_the_sorter_gives_what_a_stable_sort_gives(chunk: int) -> None:
    rng = np.random.default_rng(chunk)
    t = np.sort(rng.integers(0, 5_000_000, 3000))
    t -= np.where(rng.random(3000) < 0.2, rng.integers(0, 900_000, 3000), 0)
    events = make_events(t, np.arange(3000), np.zeros(3000), np.ones(3000))
    # no step back of a second, which would be a reset
    assert np.diff(t).min() > -1_000_000
    integrity = IntegrityReport()
    sorter = EventSorter(integrity, StreamInfo(1 << 14, 1))
    sorter._enough = 0  # gives out what it can at once
    found: list[Events] = []
    for begin in range(0, 3000, chunk):
        part = events[begin : begin + chunk]
        found += list(sorter.feed(part, np.arange(begin, begin + len(part))))
        sorter._enough = 0
    found += list(sorter.flush())
    wanted = events[np.argsort(t, kind="stable")]
    assert join_events(found).tolist() == wanted.tolist()
    assert integrity.unsorted == int(np.count_nonzero(t < np.maximum.accumulate(t)))
    assert not integrity.unplaced


def test_what_is_too_late_comes_in_a_part_of_its_own() -> None:
    integrity = IntegrityReport()
    sorter = EventSorter(integrity, StreamInfo(64, 48))
    count = 4 * MAX_REORDER_EVENTS
    zeros = np.zeros(count, np.int64)
    dense = make_events(np.arange(count) // 8, zeros, zeros, zeros)
    parts = list(sorter.feed(dense, zeros))
    late = make_events([5], [1], [1], [1])
    parts += list(sorter.feed(late, np.zeros(1, np.int64)))
    parts += list(sorter.flush())
    assert sum(map(len, parts)) == count + 1
    assert (integrity.unsorted, integrity.unplaced) == (1, 1)
