"""A camera heard by a node of ROS 2 that shares nothing with us, as on another machine.

Fast DDS is the middleware that ROS 2 comes with. The camera is in one network namespace, the node
in another; a recording of the same run says what it has to hear.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.drivers.clock import sleep_s
from evs.drivers.files.bags.library import typestore
from evs.drivers.files.bags.records import BagScan, scan_mcap
from evs.drivers.ros2 import Ros2Publisher
from evs.drivers.search_path import search_path
from evs.msgs import EventPacket, StreamInfo, make_events
from evs.msgs.codecs import PayloadReader
from links.link import Link
from links.ros2 import Listener

pytestmark = pytest.mark.integration

pytest.importorskip("cyclonedds")

DOMAIN = 1 + os.getpid() % 200
"""other runs of this test on this machine have theirs"""

TICKS = 300
Messages = dict[str, list[dict[str, Any]]]
"""topic -> its messages"""
EVS = [sys.executable, "-W", "error", "-m", "evs.launch.main"]
SCENE = ["--scene", "gymnasium:envs/mujoco/assets/humanoid.xml", "render.spp=1"]
CAMERA = [
    *("--sensor", "davis346", "sensor.width=128", "sensor.height=96", "name=event_camera"),
    *("sensor.aps.enabled=true", "sensor.imu.enabled=true", "scene.control=random"),
    *("--duration", str(TICKS / 1000), "--pace", "realtime", "--quiet"),
]


def emulate(folder: Path, **sink: Any) -> list[str]:
    """The command: for ROS 2, and into a bag and an AEDAT4 file."""
    more = {"type": "ros2", "domain_id": DOMAIN, "wait_for": 1, "wait_s": 60, **sink}
    words = [f"sink.0.{key}={value}" for key, value in more.items()]
    words += ["sink.1.type=rosbag2", f"sink.1.file={folder}/run.mcap"]
    encoding = [f"sink.1.encoding={sink['encoding']}"] if "encoding" in sink else []
    return [*EVS, "emulate", *SCENE, *CAMERA, *words, *encoding, "--record", f"{folder}/run.aedat4"]


def plain(message: Any) -> dict[str, Any]:
    """A message of the bag as the listener prints it."""
    told: dict[str, Any] = {}
    for key, value in vars(message).items():
        if key == "header":
            told["stamp"] = value.stamp.sec * 10**9 + value.stamp.nanosec
            told["frame_id"] = value.frame_id
        elif key == "transforms":
            told[key] = [{"place": k, **plain(one)} for k, one in enumerate(value)]
        elif key in ("transform", "pose"):
            told |= plain(value)
        elif key == "roi":
            told |= {"x_offset": 0, "y_offset": 0, "roi_height": 0, "roi_width": 0}
            told["do_rectify"] = 0
        elif key in ("events", "data"):
            told[key] = value.tobytes().hex()
        elif isinstance(value, np.ndarray):
            told[key] = value.tolist()
        elif hasattr(value, "z"):
            told[key] = [getattr(value, axis) for axis in "xyzw" if hasattr(value, axis)]
        elif not key.startswith("_"):
            told[key] = int(value) if isinstance(value, bool) else value
    return told


def stamp(message: dict[str, Any]) -> int:
    """The time of a message, ns; that of /tf is in its only transform."""
    return int(message.get("transforms", [message])[0]["stamp"])


def recorded(file: Path) -> Messages:
    """What a bag holds."""
    found: Messages = {}
    for one in scan_mcap(file, BagScan()):
        if one.kind.startswith("std_msgs"):
            continue
        message = typestore(2).deserialize_cdr(one.data, one.kind)
        found.setdefault(one.topic, []).append(plain(message))
    return found


def check(heard: Messages, folder: Path, encoding: str, reliable: bool) -> None:
    """All of it, to the last bit, from when the node knew of the camera.

    Best effort, a busy machine may lose some: what has come is right, and most has.
    """
    wanted = recorded(folder / "run.mcap")
    assert heard["/tf_static"] == wanted.pop("/tf_static")
    for name in ("events", "imu", "image_raw", "camera_info"):
        frame = "event_camera_imu_frame" if name == "imu" else "event_camera_optical_frame"
        assert {one["frame_id"] for one in wanted[f"/event_camera/{name}"]} == {frame}
    stamps = [one["stamp"] for one in wanted["/event_camera/image_raw"]]
    assert [one["stamp"] for one in wanted["/event_camera/camera_info"]] == stamps
    wanted["/clock"] = [{"stamp": 10**6 * (k + 1)} for k in range(TICKS)]
    kept = {topic: heard[topic] for topic in wanted}
    for topic, messages in wanted.items():
        assert len(kept[topic]) > len(messages) / 2, topic
        by_stamp = {stamp(one): one for one in messages}
        assert kept[topic] == [by_stamp[stamp(one)] for one in kept[topic]]
        if reliable:
            assert kept[topic] == messages[-len(kept[topic]) :], topic
    check_events(kept["/event_camera/events"], folder, encoding)
    check_places(kept["/event_camera/pose"], kept["/tf"], reliable)


def check_events(packets: list[dict[str, Any]], folder: Path, encoding: str) -> None:
    """The events themselves, against a recording in another format."""
    truth, reader = evs.read(folder / "run.aedat4"), PayloadReader(encoding)
    assert len(truth) > 10_000
    for one in packets:
        events = reader.events(bytes.fromhex(one["events"]), one["time_base"])
        assert one["stamp"] == 1000 * events["t"][0]
        first = np.searchsorted(truth["t"], events["t"][0])
        assert np.array_equal(events, truth[first : first + len(events)])


def check_places(poses: list[Any], transforms: list[Any], reliable: bool) -> None:
    """A pose of each tick, and the same for tf, of a camera that looks at a robot."""
    moved = {one["transforms"][0]["stamp"]: one["transforms"] for one in transforms}
    assert len(poses) > TICKS / 2
    assert not reliable or len(moved) == len(transforms) >= len(poses) - 1
    for pose in poses:
        assert pose["frame_id"] == "world"
        assert np.linalg.norm(pose["orientation"]) == pytest.approx(1)
        for one in moved.get(pose["stamp"], []):
            assert (one["frame_id"], one["child_frame_id"]) == ("world", "event_camera_link")
            assert one["translation"] == pose["position"]
            assert np.linalg.norm(one["rotation"]) == pytest.approx(1)
    stamps = [one["stamp"] for one in poses]
    assert stamps == sorted(set(stamps))
    assert not reliable or stamps == [10**6 * k for k in range(stamps[0] // 10**6, TICKS + 1)]


@pytest.mark.parametrize(
    ("encoding", "reliable"),
    [
        ("evt3", True),
        pytest.param("evt3", False, marks=pytest.mark.slow),
        pytest.param("libcaer", True, marks=pytest.mark.slow),
        pytest.param("libcaer_cmp", True, marks=pytest.mark.slow),
        pytest.param("mono", True, marks=pytest.mark.slow),
    ],
)
def test_another_machine_hears_every_topic_to_the_last_bit(
    link: Link, tmp_path: Path, encoding: str, reliable: bool
) -> None:
    far = Listener(link.far.run, DOMAIN, "/event_camera", reliable=reliable)
    words = emulate(
        tmp_path, interface="evs0", insecure="true", encoding=encoding, reliable=reliable
    )
    camera = link.near.run(words, stdout=-1, stderr=-1, text=True)
    out, errors = camera.communicate(timeout=120)
    # a busy machine may be late, and says so
    others = [line for line in errors.splitlines() if "pace free" not in line]
    assert (camera.returncode, out, others) == (0, "", [])
    check(far.heard(), tmp_path, encoding, reliable)


@pytest.mark.parametrize("worker", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_this_machine_hears_it_without_being_told_where_and_others_do_not(
    link: Link, tmp_path: Path, worker: bool
) -> None:
    """By default on the loopback interface, which other machines do not reach.

    So it is too where the sink has a process of its own.
    """
    near = Listener(link.near.run, DOMAIN, "/event_camera")
    far = Listener(link.far.run, DOMAIN, "/event_camera")
    camera = link.near.run(emulate(tmp_path, worker=worker), stdout=-1, stderr=-1, text=True)
    camera.communicate(timeout=120)
    assert camera.returncode == 0
    check(near.heard(), tmp_path, "evt3", False)
    assert far.heard() == {}


NODE = """
import sys
from cyclonedds.domain import Domain, DomainParticipant
from evs.drivers.clock import monotonic_s, sleep_s
from reference.ros_readers import Ears
domain = Domain(int(sys.argv[1]), sys.argv[2])
ears, found, ends_s = Ears(int(sys.argv[1]), "/eye", ("events",)), [], monotonic_s() + 120
print("ready", flush=True)
while not found and monotonic_s() < ends_s:
    sleep_s(0.01)
    found += ears.take("events")
print(len(found) > 0)
"""
ON_LO = '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'
STAYING = """<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers>
<Peer address="localhost"/></Peers></Discovery>"""


@pytest.mark.parametrize(
    ("general", "discovery"),
    [(ON_LO, ""), ("<AllowMulticast>false</AllowMulticast>", STAYING)],
    ids=["ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE"],
)
def test_nodes_on_cyclone_dds_that_stay_on_this_machine_find_it(
    general: str, discovery: str
) -> None:
    """Configured as ROS 2 configures them: by one interface, or without multicast."""
    domain = DOMAIN + 1
    text = f"<CycloneDDS><Domain><General>{general}</General>{discovery}</Domain></CycloneDDS>"
    node = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", NODE, str(domain), text],
        env={**os.environ, "PYTHONPATH": search_path()},
        stdout=-1,
        text=True,
    )
    sink = Ros2Publisher(domain_id=domain, node="eye", wait_for=1, wait_s=120.0)
    sink.open([StreamInfo(9, 9)])
    while node.poll() is None:
        sink.write(EventPacket(0, 0, 1000, 9, 9, make_events([5], [1], [2], [1])))
        sleep_s(0.01)
    sink.close()
    assert node.communicate()[0].split() == ["ready", "True"]
