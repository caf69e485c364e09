"""Foxglove's files and server, read by other programs: mcap, protobuf, rosbags and websockets."""

from __future__ import annotations

import base64
import json
import os
import struct
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.bus.address import free_address
from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.run import config as pipeline
from evs.drivers.search_path import search_path
from evs.drivers.sink_config import SinkConfig
from evs.drivers.viewer import FoxgloveSink
from evs.drivers.viewer.outbox import Letter
from evs.launch import main as program
from evs.msgs import EventPacket, Events, EvsError, Frame, Pose, StreamInfo
from evs.msgs.codecs import PayloadReader
from evs.msgs.pictures import OFF_RGB, ON_RGB, PAPER
from reference.mjcf import BAR
from reference.streams import random_packet
from reference.worker_packets import INFO, worker_sink
from tests.support.full_disk import fill

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")
mcap_reader = pytest.importorskip("mcap.reader")
mcap_errors = pytest.importorskip("mcap.exceptions")
websockets = pytest.importorskip("websockets.sync.client")

OPTICS = {
    "width": 64,
    "height": 48,
    "distortion_model": "plumb_bob",
    "d": [0.1, 0.0, 0.0, 0.0, 0.0],
    "k": [60.0, 0, 32, 0, 61, 24, 0, 0, 1],
    "r": [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
    "p": [60.0, 0, 32, 0, 0, 61, 24, 0, 0, 0, 1, 0],
}
STREAM = StreamInfo(64, 48, camera="eye", frames=True, camera_info=OPTICS)
TOPICS = {
    "/eye/event_image": "foxglove.RawImage",
    "/eye/event_rate": "evs.EventRate",
    "/eye/events": "event_camera_msgs/msg/EventPacket",
    "/eye/luminance": "foxglove.RawImage",
    "/eye/image_raw": "foxglove.RawImage",
    "/eye/camera_info": "foxglove.CameraCalibration",
    "/tf": "foxglove.FrameTransform",
}


def packet(seq: int, base_us: int = 0) -> EventPacket:
    return random_packet(seq, 30, (64, 48), start_us=base_us)


def give(sink: FoxgloveSink, ticks: int, base_us: int = 0) -> None:
    """Everything of some ticks, as a run gives it."""
    for seq in range(ticks):
        t_us = base_us + 1000 * seq + 1000
        if seq % 10 == 9:
            pixels = np.full((48, 64), 100 * seq, np.uint16)
            sink.write_frame(
                Frame(seq // 10, t_us - 900, t_us - 900, t_us - 400, t_us, pixels, "eye")
            )
        if sink.wants_pose("eye"):
            sink.write_pose(Pose(seq, t_us, (1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5), "eye"))
        if sink.wants_light("eye", t_us):
            light = np.full((48, 64), 0.25, np.float32)
            light[0, 0] = 1.0
            sink.write_light("eye", t_us, light)
        sink.write(packet(seq, base_us))


class Decoder:
    """Messages by the schemas that came with them, with libraries that know nothing of evs."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}

    def decode(self, name: str, encoding: str, schema: bytes, data: bytes) -> Any:
        if encoding == "jsonschema":
            return json.loads(data)
        if name not in self._made:
            self._made[name] = {"protobuf": self._protobuf, "ros2msg": self._ros}[encoding](
                name, schema
            )
        return self._made[name](data)

    @staticmethod
    def _protobuf(name: str, schema: bytes) -> Any:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(name)).FromString

    @staticmethod
    def _ros(name: str, schema: bytes) -> Any:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(schema.decode(), name))
        return lambda data: store.deserialize_cdr(data, name)


def read(file: Path) -> dict[str, list[tuple[int, Any]]]:
    """Topic -> (log time, ns, message) of everything in an MCAP file."""
    found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    decoder = Decoder()
    with file.open("rb") as data:
        for schema, channel, message in mcap_reader.make_reader(data).iter_messages():
            assert TOPICS[channel.topic] == schema.name
            assert message.publish_time == message.log_time
            decoded = decoder.decode(schema.name, schema.encoding, schema.data, message.data)
            found[channel.topic].append((message.log_time, decoded))
    return found


def stamp_ns(stamp: Any) -> int:
    seconds = stamp.seconds if hasattr(stamp, "seconds") else stamp.sec
    return 1_000_000_000 * seconds + (stamp.nanos if hasattr(stamp, "nanos") else stamp.nanosec)


def picture(image: Any, dtype: str, planes: tuple[int, ...] = ()) -> np.ndarray[Any, Any]:
    assert image.step == image.width * np.dtype(dtype).itemsize * (planes or (1,))[0]
    return np.frombuffer(image.data, dtype).reshape(image.height, image.width, *planes)


def events_of(messages: Sequence[Any], encoding: str = "evt3") -> Events:
    reader = PayloadReader(encoding)
    parts = [reader.events(one.events.tobytes(), one.time_base) for one in messages]
    return np.concatenate(parts)


def same_events(found: Events, ticks: int, base_us: int = 0) -> None:
    wanted = np.concatenate([packet(seq, base_us).events for seq in range(ticks)])
    for field in ("t", "x", "y", "p"):
        np.testing.assert_array_equal(found[field], wanted[field])


def test_an_mcap_file_has_everything_at_simulated_time(tmp_path: Path) -> None:
    sink = FoxgloveSink(mcap=tmp_path / "run.mcap")
    sink.open([STREAM])
    give(sink, 100)
    report = sink.close()
    assert report == sink.close()
    found = read(tmp_path / "run.mcap")
    assert set(found) == set(TOPICS)

    # the second window is (20, 40] ms; a pixel shows its last event
    time_ns, image = found["/eye/event_image"][1]
    assert (time_ns, stamp_ns(image.timestamp)) == (40_000_000, 40_000_000)
    assert (image.encoding, image.frame_id) == ("rgb8", "eye_optical_frame")
    wanted = np.full((48, 64, 3), PAPER, np.uint8)
    events = np.concatenate([packet(seq).events for seq in range(20, 40)])
    for event in events:
        wanted[event["y"], event["x"]] = ON_RGB if event["p"] else OFF_RGB
    np.testing.assert_array_equal(picture(image, "u1", (3,)), wanted)
    on = int(events["p"].sum())
    assert found["/eye/event_rate"][1] == (40_000_000, {"on": 50 * on, "off": 50 * (600 - on)})

    packets = [one for _, one in found["/eye/events"]]
    assert [one.seq for one in packets] == list(range(5))
    assert {(one.width, one.height, one.is_bigendian) for one in packets} == {(64, 48, False)}
    assert stamp_ns(packets[0].header.stamp) == 1000 * packet(0).events["t"][0]
    assert packets[0].header.frame_id == "eye_optical_frame"
    same_events(events_of(packets), 100)

    frames = found["/eye/image_raw"]
    assert [time_ns for time_ns, _ in frames] == list(range(10_000_000, 101_000_000, 10_000_000))
    assert stamp_ns(frames[0][1].timestamp) == 9_100_000
    assert frames[0][1].encoding == "mono16"
    assert (picture(frames[0][1], "<u2") == 900).all()

    # 99 % of the pixels are at most 0.8 of white, which is 231 in sRGB; one is brighter
    light = picture(found["/eye/luminance"][0][1], "u1")
    assert (light[0, 0], light[1, 1]) == (255, 231)

    info = found["/eye/camera_info"][0][1]
    assert (info.width, info.height, info.distortion_model) == (64, 48, "plumb_bob")
    for name in "DKRP":
        assert list(getattr(info, name)) == OPTICS[name.lower()]

    time_ns, transform = found["/tf"][0]
    assert (time_ns, stamp_ns(transform.timestamp)) == (1_000_000, 1_000_000)
    frames_of = transform.parent_frame_id, transform.child_frame_id
    assert frames_of == ("world", "eye_optical_frame")
    moved, turned = transform.translation, transform.rotation
    assert (moved.x, moved.y, moved.z) == (1, 2, 3)
    assert (turned.x, turned.y, turned.z, turned.w) == (0.5, 0.5, 0.5, 0.5)

    messages = sum(len(one) for one in found.values())
    assert (report["messages_sent"], report["messages_dropped"]) == (messages, 0)
    assert (report["windows"], report["events"], report["frames"]) == (5, 3000, 10)


def test_the_same_run_gives_the_same_messages(tmp_path: Path) -> None:
    found = []
    for name in ("a.mcap", "b.mcap"):
        sink = FoxgloveSink(mcap=tmp_path / name)
        sink.open([STREAM])
        give(sink, 50)
        sink.close()
        # the order of an index depends on the SDK
        with (tmp_path / name).open("rb") as data:
            every = mcap_reader.make_reader(data).iter_messages(log_time_order=False)
            found.append([(one.topic, said.log_time, said.data) for _, one, said in every])
    assert found[0] == found[1]
    assert len(found[0]) > 20


@pytest.mark.parametrize("encoding", ["libcaer", "mono"])
def test_other_encodings_of_the_events(encoding: str, tmp_path: Path) -> None:
    sink = FoxgloveSink(mcap=tmp_path / "a.mcap", encoding=encoding, period_us=7000)
    sink.open([STREAM])
    give(sink, 30)
    sink.close()
    packets = [one for _, one in read(tmp_path / "a.mcap")["/eye/events"]]
    assert {one.encoding for one in packets} == {encoding}
    same_events(events_of(packets, encoding), 30)


@pytest.mark.integration
@pytest.mark.parametrize("worker", ["false", "true"])
def test_a_run_records_for_foxglove(worker: str, tmp_path: Path) -> None:
    (tmp_path / "bar.xml").write_text(BAR.format(speed=40))
    (tmp_path / "p.toml").write_text(
        "duration_s = 0.1\n[scene]\nfile = 'bar.xml'\nkeyframe = 'fast'\n"
        "[sensor]\nwidth = 48\nheight = 36\n[sensor.aps]\nenabled = true\n"
        "[[sink]]\ntype = 'foxglove'\nmcap = 'run.mcap'\nperiod_us = 10000\n"
        f"worker = {worker}\n[[sink]]\ntype = 'npz'\nfile = 'run.npz'\n"
    )
    words = ["emulate", str(tmp_path / "p.toml"), "--quiet"]
    assert program.main(words) == 0
    with (tmp_path / "run.mcap").open("rb") as data:
        found: dict[str, int] = defaultdict(int)
        for _, channel, _ in mcap_reader.make_reader(data).iter_messages():
            found[channel.topic.removeprefix("/camera/")] += 1
    assert found["event_image"] == found["event_rate"] == found["camera_info"] == 10
    # the first tick's, and then one in each picture's time; a worker asks for these in its time
    least = 1 if worker == "true" else 11
    assert least <= found["luminance"] <= 11
    assert least <= found["/tf"] <= 11
    assert found["image_raw"] in (1, 2, 3)
    assert found["events"] >= 10
    # an existing file is not replaced, and its neighbour is
    assert program.main(words) == 2


@pytest.mark.integration
def test_a_worker_wants_the_first_light_before_any_packet(
    tmp_path: Path,
) -> None:
    sink = worker_sink(type="foxglove", mcap=str(tmp_path / "run.mcap"))
    sink.open([INFO])
    assert sink.wants_light("eye", INFO.tick_us)
    sink.close()


class Client:
    """Foxglove's protocol as its documentation describes it."""

    def __init__(self, port: int, *topics: str) -> None:
        self._stack = ExitStack()
        self.link = self._stack.enter_context(
            websockets.connect(
                f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=None
            )
        )
        self.texts: list[dict[str, Any]] = []
        self.channels: dict[str, dict[str, Any]] = {}
        self.times: list[int] = []
        self.found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        self._decoder = Decoder()
        while set(topics) - set(self.channels):
            self._text(self.link.recv(timeout=20))
        self._names = dict(enumerate(topics))
        subscriptions = [
            {"id": number, "channelId": self.channels[topic]["id"]}
            for number, topic in self._names.items()
        ]
        self.link.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def _text(self, data: Any) -> None:
        said = json.loads(data)
        self.texts.append(said)
        if said["op"] == "advertise":
            self.channels |= {one["topic"]: one for one in said["channels"]}

    def read_all(self) -> None:
        """Everything until the server ends."""
        from websockets.exceptions import ConnectionClosed

        with self._stack, suppress(ConnectionClosed):
            while True:
                data = self.link.recv(timeout=20)
                if isinstance(data, str):
                    self._text(data)
                elif data[0] == 2:
                    self.times.append(struct.unpack_from("<Q", data, 1)[0])
                else:
                    assert data[0] == 1
                    number, time_ns = struct.unpack_from("<IQ", data, 1)
                    self._message(self._names[number], time_ns, data[13:])

    def _message(self, topic: str, time_ns: int, data: bytes) -> None:
        channel = self.channels[topic]
        schema = channel["schema"]
        binary = channel["schemaEncoding"] == "protobuf"
        plain = base64.b64decode(schema) if binary else schema.encode()
        message = self._decoder.decode(
            channel["schemaName"], channel["schemaEncoding"], plain, data
        )
        self.found[topic].append((time_ns, message))


def test_a_client_of_the_protocol_gets_all_topics() -> None:
    sink = FoxgloveSink(address="tcp://127.0.0.1:0")
    sink.open([STREAM])
    client = Client(sink.port, *TOPICS)
    for topic, name in TOPICS.items():
        assert client.channels[topic]["schemaName"] == name
    hello = client.texts[0]
    assert (hello["op"], hello["name"], hello["capabilities"]) == ("serverInfo", "evs", ["time"])
    reading = threading.Thread(target=client.read_all)
    reading.start()
    await_poses(sink)
    give(sink, 100)
    report = sink.close()
    reading.join(20)
    found = client.found
    same_events(events_of([one for _, one in found["/eye/events"]]), 100)
    assert [time for time, _ in found["/eye/event_image"]] == [20_000_000 * k for k in range(1, 6)]
    assert len(found["/eye/image_raw"]) == 10
    assert len(found["/eye/luminance"]) == len(found["/tf"]) == 6
    assert len(found["/eye/camera_info"]) == len(found["/eye/event_rate"]) == 5
    # the clock is the simulation's
    assert client.times == [20_000_000 * k for k in range(1, 6)]
    assert (report["clients"], report["messages_dropped"], report["error"]) == (1, 0, "")
    assert report["overflow_notices"] == 0
    assert report["messages_sent"] == sum(map(len, found.values())) + len(client.times)


def await_poses(sink: FoxgloveSink) -> None:
    """Until the server knows the last subscription of a client."""
    deadline_s = monotonic_s() + 20
    while not sink.wants_pose("eye"):
        assert monotonic_s() < deadline_s
        sleep_s(0.01)


def subscribed(sink: FoxgloveSink, *topics: str) -> tuple[Client, threading.Thread]:
    """A client of an open sink, /tf included, and the thread in which it reads."""
    client = Client(sink.port, *topics, "/tf")
    reading = threading.Thread(target=client.read_all)
    reading.start()
    await_poses(sink)
    return client, reading


def test_nothing_is_computed_for_topics_without_subscribers() -> None:
    sink = FoxgloveSink(address="tcp://127.0.0.1:0")
    sink.open([STREAM])
    assert not sink.wants_pose("eye")
    assert not sink.wants_light("eye", 1000)
    give(sink, 50)
    report = sink.close()
    assert (report["windows"], report["messages_sent"], report["clients"]) == (0, 0, 0)


def test_it_waits_for_clients() -> None:
    address = free_address()
    with pytest.raises(EvsError, match=r"0 of 1 Foxglove clients subscribed .* within 0\.1 s"):
        FoxgloveSink(address=address, wait_for=1, wait_s=0.1).open([STREAM])
    sink = FoxgloveSink(address=address, wait_for=1, wait_s=20)
    opening = threading.Thread(target=sink.open, args=([STREAM],))
    opening.start()
    while not sink.port:
        # the port may be taken by now
        assert opening.is_alive()
        sleep_s(0.01)
    client = Client(int(address.rpartition(":")[2]), "/eye/events")
    opening.join(20)
    reading = threading.Thread(target=client.read_all)
    reading.start()
    give(sink, 20)
    assert sink.close()["clients"] == 1
    reading.join(20)
    same_events(events_of([one for _, one in client.found["/eye/events"]]), 20)


def test_time_may_be_set_back() -> None:
    sink = FoxgloveSink(address="tcp://127.0.0.1:0")
    sink.open([STREAM])
    client, reading = subscribed(sink, "/eye/events", "/eye/event_image")
    give(sink, 50, base_us=1_000_000)
    give(sink, 40)
    sink.close()
    reading.join(20)
    sessions = {one["sessionId"] for one in client.texts if one["op"] == "serverInfo"}
    assert len(sessions) == 2
    times = [time_ns for time_ns, _ in client.found["/eye/event_image"]]
    assert times == [1_020_000_000, 1_040_000_000, 20_000_000, 40_000_000]
    assert client.times[2:] == [1_041_000_000, 20_000_000, 40_000_000]
    assert [time_ns for time_ns, _ in client.found["/tf"]][-3:] == [
        1_000_000,
        20_000_000,
        40_000_000,
    ]
    packets = [one for _, one in client.found["/eye/events"]]
    assert [one.seq for one in packets] == [0, 1, 2, 3, 4]
    same_events(events_of(packets[:3]), 50, base_us=1_000_000)
    same_events(events_of(packets[3:]), 40)


@contextmanager
def stalled(sink: FoxgloveSink) -> Iterator[None]:
    """A thread of the sink that sends nothing."""
    go, begun = threading.Event(), threading.Event()

    def wait() -> None:
        begun.set()
        go.wait(60)

    assert sink._panels is not None
    sink._panels._outbox.put(Letter(wait, 0))
    assert begun.wait(20)
    yield
    go.set()


def test_clients_cost_the_camera_no_wait_and_drops_are_counted() -> None:
    sink = FoxgloveSink(address="tcp://127.0.0.1:0", queue=10, period_us=1000)
    sink.open([STREAM])
    client, reading = subscribed(sink, "/eye/events")
    with stalled(sink):
        give(sink, 50)
    report = sink.close()
    reading.join(20)
    packets = [one for _, one in client.found["/eye/events"]]
    # a message a tick of events, of poses, and of the time: the oldest are lost
    assert 0 < len(packets) <= 4
    assert packets[-1].seq == 49
    assert report["messages_dropped"] == 150 - 10
    # the stall itself is one
    assert report["messages_sent"] == 10 + 1
    assert report["events_dropped"] == 30 * (50 - len(packets))


def test_a_file_loses_nothing(tmp_path: Path) -> None:
    sink = FoxgloveSink(mcap=tmp_path / "a.mcap", queue=2)
    sink.open([STREAM])
    with stalled(sink):
        giving = threading.Thread(target=give, args=(sink, 100))
        giving.start()
        giving.join(0.2)
        assert giving.is_alive()
    giving.join(20)
    assert sink.close()["messages_dropped"] == 0
    same_events(events_of([one for _, one in read(tmp_path / "a.mcap")["/eye/events"]]), 100)


@pytest.mark.slow
def test_a_client_that_reads_nothing_does_not_hold_the_end() -> None:
    large = StreamInfo(640, 480, camera="eye")
    sink = FoxgloveSink(address="tcp://127.0.0.1:0", period_us=1000)
    sink.open([large])
    # this client's library reads a few messages ahead, and then no more
    deaf = Client(sink.port, "/eye/event_image", "/eye/event_rate", "/tf")
    await_poses(sink)
    # 0.9 MB each: far more than sockets keep
    for seq in range(150):
        sink.write(replace(packet(seq), width=640, height=480))
    began_s = monotonic_s()
    report = sink.close()
    # the SDK alone would wait until the client has gone, which is its keep-alive's 40 s
    assert monotonic_s() - began_s < 20
    assert (report["windows"], report["error"]) == (150, "")
    # what it lost is not silent, though the SDK counts none of it
    assert report["overflow_notices"] == 1
    deaf.link.socket.close()


@pytest.mark.integration
def test_a_full_disk_stops_the_file_and_what_came_before_is_read(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    said = fill("FoxgloveSink", "mcap", file)
    assert said.startswith(f"writing {file} stopped: File too large; the file holds what")
    read_before = 0
    with file.open("rb") as data, suppress(mcap_errors.McapError):
        for _ in mcap_reader.NonSeekingReader(data).iter_messages(log_time_order=False):
            read_before += 1
    assert read_before > 10


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({}, "one destination"),
        ({"address": "tcp://127.0.0.1:0", "mcap": "a.mcap"}, "one destination"),
        ({"mcap": "a.bag"}, r"does not end in \.mcap"),
        ({"mcap": "a.mcap", "wait_for": 1}, "belong to an address"),
        ({"mcap": "a.mcap", "insecure": True}, "belong to an address"),
        ({"mcap": "a.mcap", "period_us": 0}, "period_us is 0"),
        ({"mcap": "a.mcap", "queue": 0}, "queue is 0"),
        ({"mcap": "a.mcap", "encoding": "evt9"}, "evt9"),
        ({"address": "tcp://127.0.0.1:0", "wait_s": float("nan")}, "wait_s is nan"),
        ({"address": "ipc:///tmp/a"}, "Foxglove needs an address of the form tcp"),
        ({"address": "tcp://0.0.0.0:8765"}, "has no keys.*insecure=true"),
    ],
)
def test_what_cannot_be_is_one_line(options: dict[str, Any], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        FoxgloveSink(**options)


def test_what_cannot_be_opened_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match=r"cannot write .*no/a\.mcap: there is no folder"):
        FoxgloveSink(mcap=tmp_path / "no" / "a.mcap").open([STREAM])
    with pytest.raises(EvsError, match="set encoding = libcaer"):
        FoxgloveSink(mcap=tmp_path / "a.mcap").open([StreamInfo(4000, 4000)])
    late = StreamInfo(64, 48, config={"scene": {"start_us": 1 << 52}})
    with pytest.raises(EvsError, match=r"give a smaller scene\.start_us"):
        FoxgloveSink(mcap=tmp_path / "a.mcap").open([late])
    assert not (tmp_path / "a.mcap").exists()
    sink = FoxgloveSink(address="tcp://127.0.0.1:0")
    sink.open([STREAM])
    address = f"tcp://127.0.0.1:{sink.port}"
    with pytest.raises(EvsError, match=r"Address already in use.*give another address"):
        FoxgloveSink(address=address).open([STREAM])
    sink.close()


def test_a_port_is_free_again_once_its_sink_is_closed() -> None:
    taken = []
    for _ in range(3):
        sink = FoxgloveSink(address="tcp://127.0.0.1:0")
        sink.open([STREAM])
        sink.close()
        again = FoxgloveSink(address=f"tcp://127.0.0.1:{sink.port}")
        try:
            again.open([STREAM])
        except EvsError as reason:
            # another program may have taken it, though not every time
            taken.append(str(reason))
        else:
            again.close()
            return
    raise AssertionError(taken)


def test_only_this_machine_is_served_unless_said_so() -> None:
    for address, insecure, bound in (
        ("tcp://localhost:0", False, "127.0.0.1"),
        ("tcp://0.0.0.0:0", True, "0.0.0.0"),
    ):
        sink = FoxgloveSink(address=address, insecure=insecure)
        sink.open([STREAM])
        try:
            lines = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]
            places = [line.split()[1].split(":") for line in lines if line.split()[3] == "0A"]
            hosts = {
                ".".join(str(byte) for byte in reversed(bytes.fromhex(host)))
                for host, port in places
                if int(port, 16) == sink.port
            }
            assert hosts == {bound}
        finally:
            sink.close()


def test_without_the_extra_one_line_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(EvsError, match=r"pip install 'evs\[foxglove\]'"):
        pipeline.make_sink(SinkConfig.of(type="foxglove", mcap=str(tmp_path / "a.mcap")))


def test_nothing_else_imports_foxglove() -> None:
    code = (
        "import sys, evs, evs.drivers.viewer, evs.drivers.run.config\n"
        "assert 'foxglove' not in sys.modules\n"
    )
    environment = {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr
