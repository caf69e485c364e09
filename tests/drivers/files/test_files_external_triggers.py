"""External triggers of Prophesee's formats: words made by hand, in RAW files and in bags."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from evs.drivers import files
from evs.drivers.files import convert
from evs.msgs import EvsError, Trigger

UP, DOWN = Trigger.EXTERNAL_SIGNAL_RISING_EDGE, Trigger.EXTERNAL_SIGNAL_FALLING_EDGE
EVENTS = [(4098, 3, 5, 1), (4101, 4, 5, 0)]
TRIGGERS = [(4099, UP), (8200, DOWN)]
HALVES = (0x8001, 0x6002, 0x0005, 0x2803, 0x6003, 0xA301, 0x6005, 0x2004, 0x8002, 0x6008, 0xA300)
"""EVT3: an event, a rising edge at input 3, an event, a falling edge."""


def evt3() -> bytes:
    return struct.pack(f"<{len(HALVES)}H", *HALVES)


def wholes() -> list[int]:
    """EVT2's words, the upper halves of EVT2.1's without their vectors' x."""
    high = [0x80000040, 0x80000080]
    events = [1 << 28 | 2 << 22 | 3 << 11 | 5, 5 << 22 | 4 << 11 | 5]
    edges = [10 << 28 | 3 << 22 | 3 << 8 | 1, 10 << 28 | 8 << 22 | 3 << 8]
    return [high[0], events[0], edges[0], events[1], high[1], edges[1]]


def evt2() -> bytes:
    return struct.pack("<6I", *wholes())


def evt21(upper_first: bool) -> bytes:
    pairs = []
    for word in wholes():
        x = word >> 11 & 0x7FF if word >> 28 < 2 else 0
        pairs.append((1 << x, word & ~(0x7FF << 11) if x else word))
    return b"".join(struct.pack("<2I", *(pair[::-1] if upper_first else pair)) for pair in pairs)


def raw(path: Path, version: str, words: bytes, form: str = "") -> Path:
    lines = [f"% evt {version}", "% geometry 640x480", *([f"% format {form}"] if form else [])]
    path.write_bytes("".join(f"{line}\n" for line in lines).encode() + b"% end\n" + words)
    return path


def bag(path: Path, words: bytes) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "event_camera_msgs/msg/EventPacket"
    definition = (
        "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n"
        "string encoding\nbool is_bigendian\nuint8[] events\n"
    )
    store.register(get_types_from_msg(definition, kind))
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "eye")
    writer = rosbag2.Writer(
        path.parent / "bag", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP
    )
    with writer:
        topic = writer.add_connection("/eye/events", kind, typestore=store)
        # one cut between the events and the last edge
        for seq, part in enumerate((words[:16], words[16:])):
            data = np.frombuffer(part, np.uint8)
            message = types[kind](header, 480, 640, seq, 0, "evt3", False, data)
            writer.write(topic, seq, store.serialize_cdr(message, kind))
    return (path.parent / "bag" / "bag.mcap").rename(path)


MADE = {
    "evt3": lambda path: raw(path / "a.raw", "3.0", evt3()),
    "evt2": lambda path: raw(path / "a.raw", "2.0", evt2()),
    "evt21": lambda path: raw(
        path / "a.raw", "2.1", evt21(False), "EVT21;endianness=little;height=480;width=640"
    ),
    "imx636": lambda path: raw(
        path / "a.raw", "2.1", evt21(True), "EVT21;endianness=legacy;height=480;width=640"
    ),
    "bag": lambda path: bag(path / "a.mcap", evt3()),
}


@pytest.mark.parametrize("kind", MADE)
def test_external_triggers_are_read(kind: str, tmp_path: Path) -> None:
    path = MADE[kind](tmp_path)
    recording = files.read(path)
    assert recording.tolist() == EVENTS
    assert recording.stream.triggers
    assert recording.triggers.tolist() == TRIGGERS
    assert files.summary(path).triggers == 2
    # they are written where they fit, and refused by name where they do not
    done = convert(path, tmp_path / "b.aedat4")
    assert (done.events, done.triggers) == (2, 2)
    assert files.read(tmp_path / "b.aedat4").triggers.tolist() == TRIGGERS
    with pytest.raises(EvsError, match=r"cannot hold the triggers of .*--events-only"):
        convert(path, tmp_path / "b.csv")


def test_convert_counts_the_triggers_that_it_leaves_out(tmp_path: Path) -> None:
    path = MADE["evt3"](tmp_path)
    done = convert(path, tmp_path / "c.csv", events_only=True)
    assert done.left_out == {"triggers": 2}


def test_a_file_without_edges_has_no_triggers(tmp_path: Path) -> None:
    for version, words in (("3.0", evt3()[:8]), ("2.0", evt2()[:8])):
        recording = files.read(raw(tmp_path / "a.raw", version, words))
        assert not recording.stream.triggers
        assert recording.tolist() == EVENTS[:1]


def test_edges_before_the_time_is_told_are_no_triggers(tmp_path: Path) -> None:
    words = struct.pack("<H", 0xA001) + evt3()
    assert files.read(raw(tmp_path / "a.raw", "3.0", words)).triggers.tolist() == TRIGGERS
