"""Bags that other recorders made, torn ones, and those of several topics."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from evs.drivers import files
from evs.drivers.files import LeftOutWarning
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.bags.messages import array_bytes
from evs.drivers.files.bags.records import ros1_chunk
from evs.drivers.files.integrity import DamagedPacketWarning, TornTailWarning
from evs.launch.main import main
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, join_events
from evs.msgs.codecs import PAYLOADS, PayloadWriter
from reference.streams import random_packet

STREAM = StreamInfo(640, 480, camera="left")
DEFINITION = """std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
"""
PACKET = "event_camera_msgs/msg/EventPacket"
Send = Callable[[str, str, int, Any], None]


def ticks(count: int = 40, each: int = 50) -> list[Events]:
    return [random_packet(tick, each, (640, 480)).events for tick in range(count)]


def record(path: Path, parts: list[Events], **options: str) -> bytes:
    sink = files.recorder_for(path, **options)
    sink.open([STREAM])
    for seq, part in enumerate(parts):
        sink.write(EventPacket(seq, 0, 0, 640, 480, part))
    sink.close()
    return path.read_bytes()


def rosbag2_folder(folder: Path, plugin: str, mode: str, send: Callable[[Send], None]) -> None:
    """A folder of rosbag2's, by rosbags' own writer."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(DEFINITION, PACKET))
    writer = rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin[plugin.upper()])
    if mode != "split":
        compression = rosbag2.CompressionMode[mode.upper()]
        writer.set_compression(compression, rosbag2.CompressionFormat.ZSTD)
    topics: dict[str, Any] = {}

    def write(topic: str, kind: str, t_us: int, said: Any) -> None:
        if topic not in topics:
            topics[topic] = writer.add_connection(topic, kind, typestore=store)
        types = store.types
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "eye")
        message = types[kind](header=header, height=480, width=640, is_bigendian=False, **said)
        writer.write(topics[topic], 1000 * t_us, store.serialize_cdr(message, kind))

    with writer:
        send(write)


def foreign(path: Path, compression: str, send: Callable[[Send], None]) -> None:
    """A bag by rosbags' own writers, with messages given as (topic, type, us, bytes or fields)."""
    ros = 1 if path.suffix == ".bag" else 2
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(DEFINITION, PACKET))
    store.register(get_types_from_msg("uint8 nothing", "dvs_msgs/msg/EventArray"))
    writer: Any
    if ros == 1:
        writer = rosbag1.Writer(path)
        if compression:
            writer.set_compression(getattr(rosbag1.Writer.CompressionFormat, compression.upper()))
    else:
        plugin = rosbag2.StoragePlugin.MCAP
        writer = rosbag2.Writer(path.parent / "bag", version=9, storage_plugin=plugin)
        if compression:
            mode, form = rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD
            writer.set_compression(mode, form)
    topics: dict[str, Any] = {}

    def write(topic: str, kind: str, t_us: int, said: Any) -> None:
        if topic not in topics:
            topics[topic] = writer.add_connection(topic, kind, typestore=store)
        if isinstance(said, dict):
            types = store.types
            sequence = {"seq": 0} if ros == 1 else {}
            stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="dvx", **sequence)
            message = types[kind](header=header, height=480, width=640, is_bigendian=False, **said)
            serialise = store.serialize_ros1 if ros == 1 else store.serialize_cdr
            said = serialise(message, kind)
        writer.write(topics[topic], t_us * 1000, said)

    with writer:
        send(write)
    if ros == 2:
        (path.parent / "bag" / "bag.mcap").replace(path)


def packets_of(parts: list[Events], encoding: str, topic: str) -> Callable[[Send], None]:
    def send(write: Send) -> None:
        writer = PayloadWriter(encoding, time_origin_us=0)
        for seq, part in enumerate(parts):
            base, data = writer.payload(part)
            said = {"seq": seq, "time_base": base, "encoding": encoding}
            said["events"] = np.frombuffer(data, np.uint8)  # type: ignore[assignment]
            write(topic, PACKET, int(part["t"][-1]), said)

    return send


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
@pytest.mark.parametrize("encoding", PAYLOADS)
@pytest.mark.parametrize("compression", ["", "lz4", "bz2"])
def test_bags_of_others_whatever_their_compression(
    name: str, encoding: str, compression: str, tmp_path: Path
) -> None:
    parts = ticks()
    foreign(tmp_path / name, compression, packets_of(parts, encoding, "/dvx/events"))
    recording = files.read(tmp_path / name)
    assert recording.tobytes() == join_events(parts).tobytes()
    assert recording.stream == StreamInfo(640, 480, camera="dvx", sensor="unknown")


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_the_first_topic_is_read_and_the_others_are_counted(name: str, tmp_path: Path) -> None:
    parts = ticks(4)

    def send(write: Send) -> None:
        packets_of(parts[:2], "libcaer", "/left/events")(write)
        packets_of(parts[2:], "libcaer", "/right/events")(write)
        said = {"seq": 2, "time_base": 0, "encoding": "libcaer_zip"}
        said["events"] = np.zeros(8, np.uint8)  # type: ignore[assignment]
        write("/left/events", PACKET, 9000, said)

    foreign(tmp_path / name, "", send)
    with pytest.warns() as caught:
        list(files.messages(tmp_path / name))
    assert [each.category for each in caught] == [LeftOutWarning] * 2
    with pytest.warns(LeftOutWarning, match="2 messages with events of stream /right/events"):
        assert files.read(tmp_path / name).tobytes() == join_events(parts[:2]).tobytes()
    found = files.summary(tmp_path / name)
    assert found.left_out == {
        "messages with events of stream /right/events": 2,
        "packets of encoding 'libcaer_zip'": 1,
    }
    assert list(found.streams) == ["/left/events", "/right/events"]
    other = files.summary(tmp_path / name, stream="/right/events")
    assert (other.events, list(other.streams)) == (100, ["/right/events", "/left/events"])
    with pytest.raises(EvsError, match="'/up'; choose one of: /left/events, /right/events"):
        files.read(tmp_path / name, stream="/up")


@pytest.mark.parametrize("mode", ["message", "file", "split"])
@pytest.mark.parametrize("plugin", ["mcap", "sqlite3"])
def test_every_mode_of_rosbag2_is_read(mode: str, plugin: str, tmp_path: Path) -> None:
    parts = ticks(6)
    folder = tmp_path / "bag"
    for k in range(3 if mode == "split" else 1):
        send = packets_of(
            parts[2 * k : 2 * k + 2] if mode == "split" else parts, "evt3", "/e/events"
        )
        rosbag2_folder(tmp_path / f"{k}", plugin, mode, send)
    (tmp_path / "0").rename(folder)
    suffix = {"mcap": ".mcap", "sqlite3": ".db3"}[plugin]
    first = folder / f"0{suffix}"
    if mode == "file":
        first = folder / f"0{suffix}.zstd"
        assert not (folder / f"0{suffix}").exists()
    if mode == "split":
        # as rosbag2 splits: one folder, its metadata list the files
        for k in (1, 2):
            (tmp_path / f"{k}" / f"{k}{suffix}").rename(folder / f"{k}{suffix}")
        text = (folder / "metadata.yaml").read_text()
        lines = "".join(f"  - {k}{suffix}\n" for k in range(3))
        listed = re.sub(r"(relative_file_paths:\n)(\s*- [^\n]*\n)+", rf"\1{lines}", text)
        (folder / "metadata.yaml").write_text(listed)
    for path in (folder, first):
        assert files.read(path).tobytes() == join_events(parts).tobytes()
    assert main(["info", str(folder)]) == 0
    assert files.convert(folder, tmp_path / "a.aedat4").events == 300
    if mode == "split":
        assert files.read(first, single=True).tobytes() == join_events(parts[:2]).tobytes()
        assert files.read(folder / f"1{suffix}").tobytes() == join_events(parts[2:4]).tobytes()
        (folder / "metadata.yaml").unlink()
        assert files.read(folder).tobytes() == join_events(parts).tobytes()


def test_a_bag_of_nothing_but_damage_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.bag"

    def send(write: Send) -> None:
        for k in range(3):
            write("/dvs/events", "dvs_msgs/msg/EventArray", k, bytes(7))

    foreign(path, "", send)
    out = tmp_path / "b.aedat4"
    for words in (["info", path], ["convert", path, out], ["view", path], ["play", path, "--fast"]):
        assert main([str(word) for word in words]) == 2
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert "is damaged: none of its 3 packets can be read" in error
    assert not out.exists()


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_messages_that_are_damaged_are_told_and_the_others_read(name: str, tmp_path: Path) -> None:
    parts = ticks(3)
    ros = 1 if name == "a.bag" else 2

    def send(write: Send) -> None:
        for k, part in enumerate(parts):
            data = array_bytes(part, ros, k, "dvs", 480, 640)
            write("/dvs/events", "dvs_msgs/msg/EventArray", k, data[:-40] if k == 1 else data)

    foreign(tmp_path / name, "", send)
    with pytest.warns(DamagedPacketWarning, match="1 damaged .* at byte .* 50 events, which do"):
        recording = files.read(tmp_path / name)
    assert recording.tobytes() == join_events([parts[0], parts[2]]).tobytes()
    assert recording.stream.camera == "dvs"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_a_bag_that_was_cut_off_is_read_up_to_its_last_whole_chunk(
    name: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    parts = ticks(400, 2000)
    data, whole = record(path, parts, encoding="libcaer"), join_events(parts)
    seen = set()
    for cut in range(1_200_000, len(data), len(data) // 23):
        path.write_bytes(data[:cut])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            recording = files.read(path)
        assert recording.tobytes() == whole[: len(recording)].tobytes()
        assert recording.stream == STREAM
        torn_at = files.summary(path).torn_at
        assert [each.category for each in caught] == [TornTailWarning] * (torn_at is not None)
        assert torn_at is None or f"at offset {torn_at} " in str(caught[0].message)
        seen.add(len(recording))
    # chunks are of 1 MiB
    assert len(seen) > 4


@pytest.mark.parametrize("room", [0, 100, 4035, 5000])
def test_a_bag_that_was_cut_off_keeps_the_length_of_its_first_record(
    room: int, tmp_path: Path
) -> None:
    # ROS itself fills it with 8 bytes more than rosbags
    path, parts = tmp_path / "a.bag", ticks()
    foreign(path, "", packets_of(parts, "libcaer", "/dvx/events"))
    data, begin = path.read_bytes(), len(b"#ROSBAG V2.0\n")
    fields = data[begin : begin + 4 + int.from_bytes(data[begin : begin + 4], "little")]
    rest = data[begin + 4096 : -9]
    path.write_bytes(data[:begin] + fields + room.to_bytes(4, "little") + b" " * room + rest)
    assert files.repair(path).needed
    assert files.read(path).tobytes() == join_events(parts).tobytes()
    with rosbag1.Reader(path) as bag:
        assert bag.message_count == len(parts)
    assert not files.repair(path).needed
    # one without room for an index is left as it is
    few = b"\x04\0\0\0op=\x03"
    damaged = data[:begin] + len(few).to_bytes(4, "little") + few + bytes(4) + rest
    path.write_bytes(damaged)
    with pytest.raises(EvsError, match="no room for an index"):
        files.repair(path)
    assert path.read_bytes() == damaged


def test_rosbag2s_older_storage(tmp_path: Path) -> None:
    parts = ticks()
    record(tmp_path / "a.db3", parts)
    assert (tmp_path / "a.db3").read_bytes()[:6] == b"SQLite"
    recording = files.read(tmp_path / "a.db3")
    assert recording.tobytes() == join_events(parts).tobytes()
    assert recording.stream == STREAM
    assert [one.name for one in tmp_path.iterdir()] == ["a.db3"]


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_a_bag_without_events_is_refused_and_says_what_it_holds(name: str, tmp_path: Path) -> None:
    def send(write: Send) -> None:
        write("/imu", "sensor_msgs/msg/Imu", 5, b"1234")

    foreign(tmp_path / name, "", send)
    with pytest.raises(EvsError, match="holds no events but sensor_msgs/msg/Imu"):
        files.read(tmp_path / name)


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_libcaer_drivers_usual_encoding_is_read(name: str, tmp_path: Path) -> None:
    words = np.array([0x2007, 0x3805, 0x1002, 0x4810, 0x5009], "<u2")

    def send(write: Send) -> None:
        for seq, base_us in enumerate((10_000, 20_000)):
            said = {"seq": seq, "time_base": 1000 * base_us, "encoding": "libcaer_cmp"}
            said["events"] = words.view(np.uint8)
            write("/dvx/events", PACKET, base_us, said)

    foreign(tmp_path / name, "", send)
    told = [(0, 7, 5, 1), (2, 7, 16, 1), (2, 7, 19, 1)]
    expected = [(base + t, x, y, p) for base in (10_000, 20_000) for t, x, y, p in told]
    assert files.read(tmp_path / name).tolist() == expected
    assert files.summary(tmp_path / name).left_out == {}


@pytest.mark.slow
def test_packets_that_expand_are_decoded_a_piece_at_a_time(tmp_path: Path) -> None:
    # a million words, each of twelve events, in some KB
    path = tmp_path / "a.mcap"
    words = np.full(1 << 20, 0x4FFF, "<u2")
    words[:4] = 0x8001, 0x6002, 0x0003, 0x3000
    words[4::40] = 0x3000

    def send(write: Send) -> None:
        for encoding, data in (
            ("evt3", words),
            ("libcaer_cmp", np.full((1 << 23) + 1, 0x50FF, "<u2")),
        ):
            said = {"seq": 0, "time_base": 0, "encoding": encoding, "events": data.view(np.uint8)}
            write("/dvx/events", PACKET, 10, said)

    foreign(path, "lz4", send)
    with pytest.warns() as caught:
        sizes = [len(packet) for packet in files.packets(path)]
    assert len(sizes) == 2
    assert max(sizes) <= 6 << 20
    assert "a packet of libcaer_cmp has 16777218 bytes" in str(caught[-1].message)


def test_a_chunk_of_a_ros_1_bag_has_a_bound() -> None:
    fields = {b"compression": b"bz2", b"size": ((1 << 30) + 1).to_bytes(4, "little")}
    with pytest.raises(CorruptDataError, match="it states 1073741825 bytes"):
        ros1_chunk(fields, b"")
