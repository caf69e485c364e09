"""Images, IMU samples and calibration in bags: as sensor_msgs for others, and back."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from evs.drivers import files
from evs.drivers.files.bags import BagFile, Ros2Recorder
from evs.drivers.files.bags.messages import BadMessageError, frame_of
from evs.drivers.sink import Stream
from evs.msgs import (
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    Pose,
    StreamInfo,
    empty_imu,
    make_events,
)
from reference.turns import rotation

NAMES = ["a.bag", "a.mcap", "a.db3"]
STAMPS = ("begin_us", "exposure_begin_us", "exposure_end_us", "end_us")
K = [300.0, 0.0, 173.0, 0.0, 301.0, 130.0, 0.0, 0.0, 1.0]
STREAM = StreamInfo(
    34,
    26,
    camera="eye",
    camera_info={
        "distortion_model": "plumb_bob",
        "d": [0.1, 0.0, 0.0, 0.0, 0.0],
        "k": K,
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [300.0, 0.0, 173.0, 0.0, 0.0, 301.0, 130.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    },
    frames=True,
    imu=True,
)


def samples(first_us: int) -> ImuSamples:
    made = empty_imu(3)
    random = np.random.default_rng(abs(first_us))
    made["t"] = first_us + np.arange(3)
    made["acceleration"], made["angular_velocity"] = random.normal(size=(2, 3, 3))
    return made


def frame(seq: int, dtype: str) -> Frame:
    random = np.random.default_rng(seq)
    pixels = random.integers(0, np.iinfo(dtype).max, (26, 34), dtype)
    begin, end = 5_000_000_000 + 1000 * seq, 5_000_000_900 + 1000 * seq
    return Frame(seq, begin, begin, end, end, pixels, "eye")


def pose(seq: int, t_us: int) -> Pose:
    turn = (0.0, float(np.sin(0.1 * seq)), 0.0, float(np.cos(0.1 * seq)))
    return Pose(seq, t_us, (0.5 * seq, 1.0, 2.0), turn, "eye")


def record(path: Path, dtype: str = "u1") -> tuple[list[Frame], list[ImuSamples]]:
    frames, imu = [frame(seq, dtype) for seq in range(4)], []
    sink = files.recorder_for(path)
    sink.open([STREAM])
    assert Stream.FRAMES in sink.streams
    assert Stream.IMU in sink.streams
    for seq, one in enumerate(frames):
        sink.write_frame(one)
        imu.append(samples(one.end_us - 20))
        sink.write_imu(ImuPacket(seq, imu[-1], "eye"))
        sink.write_pose(pose(seq, one.end_us))
        events = make_events([one.end_us], [seq], [seq], [1])
        sink.write(EventPacket(seq, 0, 0, 34, 26, events, "eye"))
    said = sink.close()
    assert (said["frames"], said["imu_samples"], said["events"]) == (4, 12, 4)
    assert said["poses"] == 4
    return frames, imu


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dtype", ["u1", "u2"])
def test_frames_and_imu_come_back(name: str, dtype: str, tmp_path: Path) -> None:
    frames, imu = record(tmp_path / name, dtype)
    recording = files.read(tmp_path / name)
    assert recording.stream == STREAM
    assert list(recording.frames) == frames
    assert recording.imu.tobytes() == np.concatenate(imu).tobytes()
    assert len(recording) == 4
    kinds = [type(message).__name__ for message in files.messages(tmp_path / name)]
    if name != "a.db3":
        assert kinds == ["Frame", "ImuPacket", "EventPacket"] * 4
    summary = files.summary(tmp_path / name)
    assert (summary.frames, summary.imu_samples, summary.damaged_packets) == (4, 12, 0)


@pytest.mark.parametrize("name", NAMES)
def test_a_kill_leaves_what_came_without_events(name: str, tmp_path: Path) -> None:
    sink = files.recorder_for(tmp_path / name)
    sink.open([STREAM])
    assert Stream.FRAMES in sink.streams
    assert Stream.IMU in sink.streams
    for seq in range(9):
        at = 50_000 * seq
        sink.write_frame(dataclasses.replace(frame(seq, "u1"), **dict.fromkeys(STAMPS, at)))
        sink.write_imu(ImuPacket(seq, samples(at), "eye"))
        sink.write_pose(pose(seq, at + 2))
    # what is on the disk now is what a kill leaves
    left = tmp_path / f"left-{name}"
    left.write_bytes((tmp_path / name).read_bytes())
    sink.close()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = files.read(left)
    # a tenth of a second may be lost
    assert len(found.frames) >= 7
    assert len(found.imu) >= 3 * 7
    files.repair(left)
    messages = contents(left)
    assert len(messages["/tf"]) >= 7
    assert len(messages["/dvs/pose" if name == "a.bag" else "/eye/pose"]) >= 7


@pytest.mark.parametrize("name", NAMES)
def test_others_read_them(name: str, tmp_path: Path) -> None:
    frames, imu = record(tmp_path / name)
    found: dict[str, list[Any]] = {}
    space = "/dvs" if name == "a.bag" else "/eye"
    with AnyReader([tmp_path / name]) as bag:
        for topic, t_ns, data in bag.messages():
            message = bag.deserialize(data, topic.msgtype)
            found.setdefault(topic.topic.removeprefix(space), []).append((t_ns, message))
    assert set(found) == {
        "/camera_info",
        "/events",
        "/evs_stream",
        "/exposure",
        "/image_raw",
        "/imu",
        "/pose",
        "/tf",
        "/tf_static",
    }
    for one, (t_ns, placed), (_, moved) in zip(frames, found["/pose"], found["/tf"], strict=True):
        truth, (transform,) = pose(one.seq, one.end_us), moved.transforms
        assert t_ns == 1000 * one.end_us
        assert placed.header == transform.header
        assert (placed.header.frame_id, transform.child_frame_id) == ("world", "eye_link")
        assert tuple(getattr(placed.pose.position, axis) for axis in "xyz") == truth.position
        place = transform.transform.translation
        assert (place.x, place.y, place.z) == truth.position
        assert tuple(getattr(placed.pose.orientation, axis) for axis in "xyzw") == truth.orientation
        # the body looks along its x; the optical frame, which looks along z, has y down
        body, optical = rotation(transform.transform.rotation), rotation(placed.pose.orientation)
        axes = np.stack([optical[:, 2], -optical[:, 0], -optical[:, 1]], 1)
        assert np.allclose(body, axes, atol=1e-12)
    ((_, static),) = found["/tf_static"]
    tree = [(one.header.frame_id, one.child_frame_id) for one in static.transforms]
    assert tree == [("eye_link", "eye_optical_frame"), ("eye_link", "eye_imu_frame")]
    turns = {
        tuple(getattr(one.transform.rotation, axis) for axis in "xyzw") for one in static.transforms
    }
    assert turns == {(-0.5, 0.5, -0.5, 0.5)}
    assert {said.header.frame_id for _, said in found["/events"]} == {"eye_optical_frame"}
    for one, (t_ns, image) in zip(frames, found["/image_raw"], strict=True):
        assert (image.width, image.height, image.step, image.encoding) == (34, 26, 34, "mono8")
        assert image.data.tobytes() == one.pixels.tobytes()
        assert image.header.stamp.sec * 10**6 + image.header.stamp.nanosec // 1000 == one.begin_us
        assert t_ns == one.end_us * 1000
    assert [said.data for _, said in found["/exposure"]] == [900] * 4
    ours = np.concatenate(imu)
    for sample, (_, said) in zip(ours, found["/imu"], strict=True):
        force, turn = said.linear_acceleration, said.angular_velocity
        assert [force.x, force.y, force.z] == sample["acceleration"].tolist()
        assert [turn.x, turn.y, turn.z] == sample["angular_velocity"].tolist()
        assert said.orientation_covariance[0] == -1
        assert said.header.frame_id == "eye_imu_frame"
    for (t_ns, image), (info_ns, info) in zip(
        found["/image_raw"], found["/camera_info"], strict=True
    ):
        assert (info_ns, info.header.stamp) == (t_ns, image.header.stamp)
        assert info.header.frame_id == image.header.frame_id == "eye_optical_frame"
        assert list(info.K if name == "a.bag" else info.k) == K


@pytest.mark.parametrize("name", NAMES)
def test_a_player_repeats_the_static_transforms_to_whoever_comes_later(
    name: str, tmp_path: Path
) -> None:
    record(tmp_path / name)
    with AnyReader([tmp_path / name]) as bag:
        (topic,) = (one for one in bag.connections if one.topic == "/tf_static")
    ext: Any = topic.ext
    if name == "a.bag":
        assert ext.latching == 1
    else:
        (quality,) = ext.offered_qos_profiles
        assert (quality.durability.name, quality.reliability.name, quality.depth) == (
            "TRANSIENT_LOCAL",
            "RELIABLE",
            1,
        )


def contents(path: Path) -> dict[str, list[Any]]:
    """Topic -> messages of a bag."""
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as bag:
        for topic, _, data in bag.messages():
            found.setdefault(topic.topic, []).append(bag.deserialize(data, topic.msgtype))
    return found


def test_topics_and_frames_are_named_as_a_live_cameras(tmp_path: Path) -> None:
    more: dict[str, Any] = {"node": "event_camera", "namespace": "robot/head"}
    more |= {"camera_frame_id": "lens", "imu_frame_id": "gyro", "link_frame_id": "body"}
    more |= {"world_frame": "map"}
    sink = Ros2Recorder(tmp_path / "a.mcap", **more)
    sink.open([dataclasses.replace(STREAM, camera="left-eye 2")])
    sink.write_frame(frame(0, "u1"))
    sink.write_imu(ImuPacket(0, samples(5), "eye"))
    sink.write_pose(pose(0, 9))
    sink.close()
    found = contents(tmp_path / "a.mcap")
    space = "/robot/head/event_camera"
    names = {"camera_info", "evs_stream", "exposure", "image_raw", "imu", "pose"}
    assert set(found) == {f"{space}/{name}" for name in names} | {"/tf", "/tf_static"}
    assert found[f"{space}/pose"][0].header.frame_id == "map"
    (moved,) = found["/tf"][0].transforms
    assert (moved.header.frame_id, moved.child_frame_id) == ("map", "body")
    assert found[f"{space}/image_raw"][0].header.frame_id == "lens"
    assert found[f"{space}/imu"][0].header.frame_id == "gyro"
    (static,) = found["/tf_static"]
    assert [one.child_frame_id for one in static.transforms] == ["lens", "gyro"]
    # a name that ROS does not have becomes one; without an IMU, or tf_static, less is written
    sink = Ros2Recorder(tmp_path / "b.mcap")
    sink.open([dataclasses.replace(STREAM, camera="left-eye 2", frames=False, imu=False)])
    sink.close()
    found = contents(tmp_path / "b.mcap")
    assert set(found) == {"/left_eye_2/camera_info", "/left_eye_2/evs_stream", "/tf_static"}
    (static,) = found["/tf_static"]
    assert [one.child_frame_id for one in static.transforms] == ["left_eye_2_optical_frame"]
    sink = Ros2Recorder(tmp_path / "c.mcap", tf=False)
    sink.open([dataclasses.replace(STREAM, camera_info={})])
    sink.write_frame(frame(0, "u1"))
    sink.write_pose(pose(0, 9))
    sink.close()
    found = contents(tmp_path / "c.mcap")
    assert "/eye/pose" in found
    assert not {"/tf", "/tf_static"} & set(found)
    (info,) = found["/eye/camera_info"]
    assert (info.width, info.height, info.k.any(), len(info.d)) == (34, 26, False, 0)
    for bad in ({"node": "a b"}, {"namespace": "a b"}, {"link_frame_id": "eye_imu_frame"}):
        with pytest.raises(EvsError):
            Ros2Recorder(tmp_path / "d.mcap", **bad).open([STREAM])  # type: ignore[arg-type]
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.mcap", "b.mcap", "c.mcap"]


@pytest.mark.parametrize("name", NAMES)
def test_what_was_not_declared_or_does_not_fit_is_refused(name: str, tmp_path: Path) -> None:
    sink: Any = files.recorder_for(tmp_path / name)
    sink.open([dataclasses.replace(STREAM, frames=False, imu=False, camera_info={})])
    with pytest.raises(EvsError, match="without frames: set frames of its StreamInfo"):
        sink.write_frame(frame(0, "u1"))
    with pytest.raises(EvsError, match="without imu"):
        sink.write_imu(ImuPacket(0, samples(0), "eye"))
    sink.close()
    sink = files.recorder_for(tmp_path / name)
    sink.open([STREAM])
    with pytest.raises(EvsError, match="cannot record imu at -5 us"):
        sink.write_imu(ImuPacket(0, samples(-5), "eye"))
    with pytest.raises(EvsError, match="cannot record poses at 2147483648000000 us"):
        sink.write_pose(pose(0, 2**31 * 10**6))
    sink.close()
    assert len(files.read(tmp_path / name)) == 0


class Said:
    """An image message."""

    class header:  # noqa: N801
        class stamp:  # noqa: N801
            sec, nanosec = 1, 2999

    encoding, is_bigendian, height, width, step = "mono16", 1, 2, 3, 8
    data = np.arange(16, dtype=np.uint8)


def test_images_with_padding_of_other_machines_and_in_colour() -> None:
    found = frame_of(Said, 5, "eye", 7)
    assert found is not None
    assert (found.seq, found.begin_us, found.end_us) == (5, 1_000_002, 1_000_009)
    assert found.pixels.tolist() == [[1, 0x203, 0x405], [0x809, 0xA0B, 0xC0D]]
    assert found.pixels.dtype == np.uint16
    for key, value, says in (
        ("step", 5, "rows of 5 bytes"),
        ("data", Said.data[:15], "has 15 bytes"),
        ("height", 0, "0 px"),
    ):
        with pytest.raises(BadMessageError, match=says):
            frame_of(type("Odd", (Said,), {key: value}), 0, "eye", 0)
    assert frame_of(type("Odd", (Said,), {"encoding": "rgb8"}), 0, "eye", 0) is None


def test_frames_of_a_recording_with_none_are_none(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    sink = Ros2Recorder(path)
    sink.open([dataclasses.replace(STREAM, frames=False, imu=False)])
    sink.write(EventPacket(0, 0, 0, 34, 26, make_events([5], [1], [2], [1])))
    sink.close()
    recording = files.read(path)
    assert recording.frames == ()
    assert len(recording.imu) == 0
    assert not BagFile.at(path).stream.frames
