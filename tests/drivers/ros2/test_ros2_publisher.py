"""A camera on the topics of ROS 2, heard by readers of Cyclone DDS in this process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.files.bags.library import typestore
from evs.drivers.ros2 import Ros2Publisher
from evs.drivers.ros2.names import GLOBAL, PRIVATE, Quality
from evs.drivers.search_path import search_path
from evs.drivers.sink import Stream
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, Pose, StreamInfo
from evs.msgs.codecs import PAYLOADS, PayloadReader
from evs.msgs.imu import empty_imu
from reference.ros_readers import KINDS, Ears, domains, ns, writers
from reference.streams import random_packet
from reference.turns import rotation

DOMAIN = 1 + os.getpid() % 200
"""of this test run: others on this machine have theirs"""

TICKS = 40
INFO = {
    "width": 346,
    "height": 260,
    "distortion_model": "plumb_bob",
    "d": [0.1, 0.2, 0.3, 0.4, 0.5],
    "k": [float(k) for k in range(9)],
    "r": [float(k) for k in range(9, 18)],
    "p": [float(k) for k in range(18, 30)],
}
STREAM = StreamInfo(346, 260, "eye", frames=True, imu=True, camera_info=INFO)


def packet(seq: int, count: int = 300, camera: str = "eye") -> EventPacket:
    return random_packet(seq, count, camera=camera)


def frame(seq: int, begin_us: int) -> Frame:
    pixels = np.full((260, 346), seq, np.uint8)
    pixels[seq, 2 * seq] = 255
    return Frame(seq, begin_us, begin_us, begin_us + 200, begin_us + 300, pixels, "eye")


def samples(tick: int) -> ImuPacket:
    made = empty_imu(2)
    made["t"] = [1000 * tick + 400, 1000 * tick + 900]
    made["acceleration"] = [[1, 2, 3], [0.1, tick, -9.81]]
    made["angular_velocity"] = [[4, 5, 6], [7, 8, tick]]
    return ImuPacket(tick, made, "eye")


def pose(tick: int) -> Pose:
    half = 0.5 * tick / TICKS
    turn = (0.0, float(np.sin(half)), 0.0, float(np.cos(half)))
    return Pose(tick, 1000 * tick + 1000, (0.1 * tick, -1.0, 2.0), turn, "eye")


def run_tick(sink: Ros2Publisher, tick: int) -> None:
    """One tick as the run loop hands it over."""
    if tick % 10 == 4:
        sink.write_frame(frame(tick // 10, 1000 * tick + 100))
    sink.write_imu(samples(tick))
    if sink.wants_pose("eye"):
        sink.write_pose(pose(tick))
    sink.write(packet(tick))


@pytest.fixture
def opened() -> Iterator[Any]:
    made: list[Ros2Publisher] = []

    def make(*streams: StreamInfo, **more: Any) -> Ros2Publisher:
        made.append(Ros2Publisher(domain_id=DOMAIN, **more))
        made[-1].open(streams or [STREAM])
        return made[-1]

    yield make
    for sink in made:
        sink.close()


def test_it_is_a_sink_of_all_that_ros_has_a_message_for() -> None:
    assert set(Ros2Publisher().streams) == {Stream.EVENTS, Stream.FRAMES, Stream.IMU, Stream.POSE}


@pytest.mark.parametrize("reliable", [False, True])
@pytest.mark.parametrize("encoding", PAYLOADS)
def test_every_topic_is_heard_as_it_was_said(opened: Any, encoding: str, reliable: bool) -> None:
    sink = opened(encoding=encoding, reliable=reliable)
    ears = Ears(DOMAIN, "/eye", tuple(KINDS), reliable)
    for tick in range(TICKS):
        run_tick(sink, tick)
    sink.flush(30.0)
    heard = {name: ears.take(name) for name in KINDS}
    # before the first packet nobody had looked who is there: the samples of the first tick are gone
    reader = PayloadReader(encoding)
    for seq, one in enumerate(heard["events"]):
        truth = packet(seq).events
        assert (one.seq, one.encoding, one.is_bigendian) == (seq, encoding, False)
        assert (one.width, one.height, one.header.frame_id) == (346, 260, "eye_optical_frame")
        assert ns(one.header.stamp) == 1000 * truth["t"][0]
        assert np.array_equal(reader.events(bytes(one.events), one.time_base), truth)
    assert len(heard["events"]) == TICKS
    assert len(heard["imu"]) == 2 * (TICKS - 1)
    for k, one in enumerate(heard["imu"]):
        told = samples(1 + k // 2).samples[k % 2]
        assert (ns(one.header.stamp), one.header.frame_id) == (1000 * told["t"], "eye_imu_frame")
        assert [getattr(one.linear_acceleration, axis) for axis in "xyz"] == list(
            told["acceleration"]
        )
        assert [getattr(one.angular_velocity, axis) for axis in "xyz"] == list(
            told["angular_velocity"]
        )
        assert one.orientation_covariance[0] == -1
    for k, one in enumerate(heard["image_raw"]):
        told = frame(k, 10_000 * k + 4100)
        assert ns(one.header.stamp) == 1000 * told.exposure_begin_us
        assert (one.encoding, one.step, one.height) == ("mono8", 346, 260)
        assert bytes(one.data) == told.pixels.tobytes()
        about = heard["camera_info"][k]
        assert (about.header, about.distortion_model) == (one.header, "plumb_bob")
        assert {key: list(getattr(about, key)) for key in "dkrp"} == {
            key: INFO[key] for key in "dkrp"
        }
    assert len(heard["image_raw"]) == len(heard["camera_info"]) == 4
    for k, (one, moved) in enumerate(zip(heard["pose"], heard["/tf"], strict=True)):
        told, (transform,) = pose(k + 1), moved.transforms
        assert ns(one.header.stamp) == 1000 * told.t_us
        assert (one.header.frame_id, transform.child_frame_id) == ("world", "eye_link")
        assert transform.header == one.header
        place, turn = one.pose.position, one.pose.orientation
        assert (place.x, place.y, place.z) == told.position
        assert (turn.x, turn.y, turn.z, turn.w) == told.orientation
        assert vars(transform.transform.translation) == vars(place)
        # the body looks along its x; the optical frame, which looks along z, has y down
        body, optical = rotation(transform.transform.rotation), rotation(turn)
        forward, left, up = optical[:, 2], -optical[:, 0], -optical[:, 1]
        assert np.allclose(body, np.stack([forward, left, up], 1), atol=1e-12)
    assert len(heard["pose"]) == TICKS - 1
    assert [ns(one.clock) for one in heard["/clock"]] == [10**6 * (k + 1) for k in range(TICKS)]
    said = sink.close()
    assert said["messages_dropped"] == said["packets_unread"] == said["events_dropped"] == 0
    assert said["events_sent"] == 300 * TICKS
    assert said["messages_sent"]["/clock"] == TICKS
    assert said["bytes_sent"] > 4 * 346 * 260


def test_simulated_time_never_runs_back_and_nothing_comes_from_the_future(opened: Any) -> None:
    """A node with use_sim_time: its clock is the last /clock that came."""
    sink = opened(event_message_time_threshold=3e-3)
    ears = Ears(DOMAIN, "/eye", tuple(KINDS))
    now_ns = -1
    for tick in range(TICKS):
        run_tick(sink, tick)
        sink.flush(30.0)
        for one in ears.take("/clock"):
            assert ns(one.clock) > now_ns
            now_ns = ns(one.clock)
        assert now_ns == 10**6 * (tick + 1)
        for name in ("events", "imu", "image_raw", "camera_info", "pose"):
            stamps = [ns(one.header.stamp) for one in ears.take(name)]
            assert stamps == sorted(stamps)
            assert all(stamp <= now_ns for stamp in stamps)
            # and it is recent: as long as a message gathers
            assert all(stamp > now_ns - 4 * 10**6 for stamp in stamps)
        assert all(ns(one.transforms[0].header.stamp) <= now_ns for one in ears.take("/tf"))


@pytest.mark.parametrize("encoding", PAYLOADS)
def test_a_loop_that_is_reset_sets_the_clock_back(opened: Any, encoding: str) -> None:
    streams = [StreamInfo(346, 260, name, camera_info=INFO) for name in ("left", "right")]
    more = {"namespace": "rig", "encoding": encoding, "event_message_time_threshold": 1.0}
    sink = opened(*streams, **more)
    left = Ears(DOMAIN, "/rig/left", ("events", "camera_info", "/clock"))

    def episode(ticks: int = 5, count: int = 10) -> None:
        for seq in range(ticks):
            for name in ("left", "right"):
                sink.write(packet(seq, count, name))

    episode()
    # who comes between two episodes is seen, too
    right = Ears(DOMAIN, "/rig/right", ("events",))
    episode()
    episode(1, 0)
    sink.flush(30.0)
    once = [10**6 * (k + 1) for k in range(5)]
    assert [ns(one.clock) for one in left.take("/clock")] == [*once, *once, 10**6]
    assert [ns(one.header.stamp) for one in left.take("camera_info")] == [10**6] * 3
    truth = np.concatenate([packet(seq, 10).events for seq in range(5)])
    for ears, episodes in ((left, 2), (right, 1)):
        heard = ears.take("events")
        assert len(heard) == episodes
        for one in heard:
            told = PayloadReader(encoding).events(bytes(one.events), one.time_base)
            assert np.array_equal(told, truth)


def test_packets_that_come_many_at_once_are_in_step_with_what_lies_beside(opened: Any) -> None:
    """A network that takes eight ticks at once hands over eight packets after eight ticks' IMU."""
    sink = opened()
    ears = Ears(DOMAIN, "/eye", ("imu", "/clock"))
    sink.write(packet(0))
    for tick in range(1, 9):
        sink.write_imu(samples(tick))
    for tick in range(1, 9):
        sink.write(packet(tick))
        sink.flush(30.0)
        assert [ns(one.clock) for one in ears.take("/clock")][-1] == 10**6 * (tick + 1)
        stamps = [ns(one.header.stamp) for one in ears.take("imu")]
        assert stamps == [10**6 * tick + 400_000, 10**6 * tick + 900_000]


def test_nothing_is_made_for_topics_that_nobody_reads(
    opened: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from evs.drivers.ros2 import messages

    sink = opened()
    made: list[str] = []
    before = messages.Messages._bytes

    def counted(self: Any, message: Any, kind: str) -> bytes:
        made.append(kind)
        return before(self, message, kind)

    monkeypatch.setattr(messages.Messages, "_bytes", counted)
    for tick in range(5):
        run_tick(sink, tick)
    assert made == []
    assert not sink.wants_pose("eye")
    ears = Ears(DOMAIN, "/eye", ("events", "/tf"))
    for tick in range(5, 10):
        run_tick(sink, tick)
    assert set(made) == {"event_camera_msgs/msg/EventPacket", "tf2_msgs/msg/TFMessage"}
    sink.flush(30.0)
    heard = ears.take("events")
    # who comes later is not sent what was before; seq counts messages, as the drivers' does
    assert [one.seq for one in heard] == [0, 1, 2, 3, 4]
    assert ns(heard[0].header.stamp) > 5 * 10**6
    del ears, heard
    for tick in range(10, 15):
        run_tick(sink, tick)
    said = sink.close()
    assert said["packets_unread"] == 10
    assert said["messages_sent"]["/eye/events"] == 5


def test_who_comes_back_gets_nothing_from_before(opened: Any) -> None:
    sink = opened(event_message_time_threshold=5e-3)
    ears = Ears(DOMAIN, "/eye", ("events",))
    for tick in range(3):
        sink.write(packet(tick))
    del ears
    sink.write(packet(3))
    ears = Ears(DOMAIN, "/eye", ("events",))
    for tick in range(4, 9):
        sink.write(packet(tick))
    sink.flush(30.0)
    (one,) = ears.take("events")
    truth = np.concatenate([packet(tick).events for tick in range(4, 9)])
    assert np.array_equal(PayloadReader("evt3").events(bytes(one.events), 0), truth)


def test_the_calibration_is_told_without_frames_too(opened: Any) -> None:
    sink = opened(replace(STREAM, frames=False, imu=False))
    ears = Ears(DOMAIN, "/eye", ("camera_info",))
    for tick in range(250):
        sink.write(packet(tick, 0))
    sink.flush(30.0)
    assert [ns(one.header.stamp) for one in ears.take("camera_info")] == [
        *(10**6, 10**8, 2 * 10**8),
    ]


def test_names_and_frames_are_what_is_asked_for(opened: Any) -> None:
    sink = opened(
        node="event_camera",
        namespace="robot/head",
        camera_frame_id="lens",
        imu_frame_id="gyro",
        world_frame="map",
        clock=False,
    )
    ears = Ears(DOMAIN, "/robot/head/event_camera", ("events", "imu", "pose", "/tf", "/clock"))
    for tick in range(3):
        run_tick(sink, tick)
    sink.flush(30.0)
    assert {one.header.frame_id for one in ears.take("events")} == {"lens"}
    assert {one.header.frame_id for one in ears.take("imu")} == {"gyro"}
    assert {one.header.frame_id for one in ears.take("pose")} == {"map"}
    (moved,) = ears.take("/tf")[-1].transforms
    assert (moved.header.frame_id, moved.child_frame_id) == ("map", "event_camera_link")
    assert ears.take("/clock") == []


DRIVERS = {
    "events": (False, False),
    "imu": (False, False),
    "image_raw": (True, False),
    "camera_info": (True, False),
    "pose": (True, False),
}
"""topic -> whether the real drivers' writers are reliable, and transient local"""


@pytest.mark.parametrize("reliable", [None, False, True])
def test_quality_of_service_is_the_drivers_unless_given(opened: Any, reliable: bool | None) -> None:
    opened(reliable=reliable)
    expected = {
        f"/eye/{name}": quality if reliable is None else (reliable, False)
        for name, quality in DRIVERS.items()
    }
    expected["/clock"] = (bool(reliable), False)
    # tf2's listeners ask for this, whatever else is given
    expected |= {"/tf": (True, False), "/tf_static": (True, True)}
    assert writers(DOMAIN, set(expected)) == expected


def test_a_subscription_by_default_gets_every_image_and_its_camera_info(opened: Any) -> None:
    """That of rclcpp and rclpy: reliable, volatile, keep last 10."""
    sink = opened()
    ears = Ears(DOMAIN, "/eye", ("image_raw", "camera_info", "pose", "events"), True, depth=10)
    sink.write(packet(0))
    images, infos, poses = [], [], 0
    for tick in range(1, 10 * TICKS):
        run_tick(sink, tick)
        sink.flush(30.0)
        images += ears.take("image_raw")
        infos += ears.take("camera_info")
        poses += len(ears.take("pose"))
    assert [ns(one.header.stamp) for one in images] == [
        10**6 * (10 * k + 4) + 10**5 for k in range(TICKS)
    ]
    assert [one.header for one in infos] == [one.header for one in images]
    assert poses == 10 * TICKS - 1
    # the drivers send these to subscriptions of sensor data alone
    assert ears.take("events") == []


def test_a_reliable_reader_that_takes_nothing_holds_up_nobody(opened: Any) -> None:
    sink = opened()
    still = Ears(DOMAIN, "/eye", ("image_raw", "camera_info"), True, depth=10)
    ears = Ears(DOMAIN, "/eye", ("image_raw",), True, depth=10)
    sink.write(packet(0, 0))
    seen = 0
    for seq in range(200):
        sink.write_frame(frame(seq % 100, 1000 * seq + 1100))
        sink.write(packet(seq + 1, 0))
        sink.flush(30.0)
        seen += len(ears.take("image_raw"))
    assert seen == 200
    assert [len(still.take(name)) for name in ("image_raw", "camera_info")] == [10, 10]
    report = sink.close()
    assert report["messages_dropped"] == 0
    assert report["messages_sent"]["/eye/image_raw"] == 200


STILL = """
import sys, time
from cyclonedds.domain import Domain
from reference.ros_readers import Ears
number, lo = int(sys.argv[1]), '<NetworkInterface address="127.0.0.1"/>'
general = f"<General><Interfaces>{lo}</Interfaces></General>"
domain = Domain(number, f"<CycloneDDS><Domain>{general}</Domain></CycloneDDS>")
images = Ears(number, "/eye", ("image_raw",), True, depth=10)
events = Ears(number, "/eye", ("events",))
print("ready", flush=True)
time.sleep(600)
"""


def test_a_reader_whose_process_is_stopped_holds_up_nobody(opened: Any) -> None:
    """It confirms nothing: a writer that waited for it would send no more, or drop messages."""
    node = subprocess.Popen(
        [sys.executable, "-c", STILL, str(DOMAIN)],
        env={**os.environ, "PYTHONPATH": search_path()},
        stdout=-1,
        text=True,
    )
    try:
        assert node.stdout is not None
        assert node.stdout.readline() == "ready\n"
        sink = opened(wait_for=1, wait_s=60.0, linger_s=0.0)
        topic = sink._nodes["eye"].topics["image_raw"]
        sink.write(packet(0, 0))
        assert topic.readers == 1
        node.send_signal(signal.SIGSTOP)
        for seq in range(300):
            sink.write_frame(frame(seq % 100, 1000 * seq + 1100))
            sink.write(packet(seq + 1, 0))
        ends_s = monotonic_s() + 60
        while topic.queue.counts.sent < 300 and monotonic_s() < ends_s:
            sleep_s(0.01)
        assert (topic.queue.counts.sent, topic.queue.counts.dropped) == (300, 0)
    finally:
        node.kill()
        node.communicate()


def test_tf_static_has_the_frames_of_each_camera_for_whoever_comes_later(opened: Any) -> None:
    rig = [StreamInfo(346, 260, "left", imu=True), StreamInfo(346, 260, "right")]
    sink = opened(*rig, namespace="rig")
    sink.write(packet(0, 10, "left"))
    sink.flush(30.0)
    (one,) = Ears(DOMAIN, "", ("/tf_static",)).take("/tf_static")
    found = {each.child_frame_id: each for each in one.transforms}
    assert {child: each.header.frame_id for child, each in found.items()} == {
        "left_optical_frame": "left_link",
        "left_imu_frame": "left_link",
        "right_optical_frame": "right_link",
    }
    for each in found.values():
        assert vars(each.transform.translation) == {"x": 0, "y": 0, "z": 0}
        # right, down and forward of the lens, in a body that has x forward, y left, z up
        axes = rotation(each.transform.rotation).T.tolist()
        assert axes == [[0, -1, 0], [0, 0, -1], [1, 0, 0]]


@pytest.mark.parametrize(
    ("options", "frames"),
    [
        ({"tf": False}, None),
        ({"tf_static": False}, None),
        # below a link of a URDF, whose parent robot_state_publisher publishes
        (
            {"tf": False, "tf_static": True, "link_frame_id": "wrist"},
            {"eye_optical_frame": "wrist", "eye_imu_frame": "wrist"},
        ),
        ({"imu_frame_id": "eye_optical_frame"}, {"eye_optical_frame": "eye_link"}),
        (
            {"camera_frame_id": "lens", "imu_frame_id": "gyro", "link_frame_id": "body"},
            {"lens": "body", "gyro": "body"},
        ),
    ],
)
def test_no_frame_gets_two_parents(
    opened: Any, options: dict[str, Any], frames: dict[str, str] | None
) -> None:
    sink = opened(**options)
    ears = Ears(DOMAIN, "/eye", ("/tf", "/tf_static"))
    for tick in range(3):
        run_tick(sink, tick)
    sink.flush(30.0)
    moved = {
        one.transforms[0].child_frame_id: one.transforms[0].header.frame_id
        for one in ears.take("/tf")
    }
    link = options.get("link_frame_id", "eye_link")
    assert moved == ({} if options.get("tf") is False else {link: "world"})
    static = [each for one in ears.take("/tf_static") for each in one.transforms]
    assert {one.child_frame_id: one.header.frame_id for one in static} == (frames or {})
    assert len(static) == len(frames or {})


def test_images_of_a_camera_without_calibration_have_an_empty_camera_info(opened: Any) -> None:
    sink = opened(replace(STREAM, camera_info={}))
    ears = Ears(DOMAIN, "/eye", ("image_raw", "camera_info"))
    for tick in range(20):
        run_tick(sink, tick)
    sink.flush(30.0)
    images, infos = ears.take("image_raw"), ears.take("camera_info")
    assert [one.header for one in infos] == [one.header for one in images]
    assert len(infos) == 2
    assert (infos[0].width, infos[0].height, infos[0].distortion_model) == (346, 260, "")
    assert [list(getattr(infos[0], key)) for key in "dkrp"] == [[], [0] * 9, [0] * 9, [0] * 12]


def test_several_cameras_are_several_nodes_and_one_clock(opened: Any) -> None:
    sink = opened(*(StreamInfo(346, 260, name) for name in ("left", "right")), namespace="rig")
    left, right = (Ears(DOMAIN, f"/rig/{name}", ("events",)) for name in ("left", "right"))
    clock = Ears(DOMAIN, "", ("/clock",))
    for seq in range(5):
        for name in ("left", "right"):
            sink.write(packet(seq, 10, name))
    sink.flush(30.0)
    assert [one.seq for one in left.take("events")] == list(range(5))
    assert [one.header.frame_id for one in right.take("events")] == ["right_optical_frame"] * 5
    assert len(clock.take("/clock")) == 5
    with pytest.raises(EvsError, match="middle"):
        sink.write(packet(9, 10, "middle"))


def test_two_sinks_of_a_process_share_a_domain(opened: Any) -> None:
    first = opened(StreamInfo(346, 260, "left"))
    second = opened(StreamInfo(346, 260, "right"), clock=False)
    right = Ears(DOMAIN, "/right", ("events",))
    second.write(packet(0, 10, "right"))
    first.close()
    second.write(packet(1, 10, "right"))
    second.flush(30.0)
    assert [one.seq for one in right.take("events")] == [0, 1]
    with pytest.raises(EvsError, match="in use by this process on another interface"):
        opened(interface="127.0.0.1")


def test_a_domain_that_the_process_entered_otherwise_is_refused() -> None:
    other = DOMAIN + 1
    mine = domains.DomainParticipant(other)
    sink = Ros2Publisher(domain_id=other)
    with pytest.raises(EvsError, match="open the sink first"):
        sink.open([STREAM])
    del mine
    # and once more, after it was closed
    for _ in range(2):
        sink.open([STREAM])
        with pytest.raises(EvsError, match="open already"):
            sink.open([STREAM])
        assert sink.close()["messages_sent"] == {"/tf_static": 1}
        assert sink.close()["messages_sent"] == {"/tf_static": 1}


def test_it_waits_for_readers_of_the_events(opened: Any) -> None:
    with pytest.raises(EvsError, match=r"0 of 1 readers of /eye/events came within 0\.05 s"):
        opened(wait_for=1, wait_s=0.05)
    first = opened()
    ears = Ears(DOMAIN, "/eye", ("events",))
    second = opened(wait_for=1, clock=False)
    second.write(packet(0))
    second.flush(30.0)
    assert len(ears.take("events")) == 1
    first.close()


class Kept:
    """A connection that keeps what its writers are given."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, str, bytes]] = []
        self.open: list[str] = []

    def writer(self, name: str, kind: str, quality: Quality) -> Any:
        def write(data: bytes) -> bool:
            self.messages.append((name, kind, data))
            return True

        self.open.append(name)
        return SimpleNamespace(
            readers=1, write=write, wait=lambda s: True, close=lambda: self.open.remove(name)
        )

    def close(self) -> None:
        assert self.open == []
        self.open.append("closed")


def test_another_connection_gets_every_message_without_dds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    kept = Kept()
    sink = Ros2Publisher(connect=lambda: kept)
    sink.open([STREAM])
    for tick in range(6):
        run_tick(sink, tick)
    sink.flush()
    assert sink.dropped == (0, 0)
    report = sink.close()
    assert kept.open == ["closed"]
    names = {name for name, _, _ in kept.messages}
    assert names == {f"/eye/{name}" for name in PRIVATE} | set(GLOBAL)
    store = typestore(2)
    decoded = [store.deserialize_cdr(data, kind) for _, kind, data in kept.messages]
    assert len(decoded) == sum(report["messages_sent"].values()) > 10
    assert [one.seq for one in decoded if hasattr(one, "seq")] == list(range(6))
