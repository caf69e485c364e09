"""Readers of Cyclone DDS in this process, and the messages of ROS as its .msg files have them."""

from __future__ import annotations

from typing import Any

import pytest

from evs.drivers.clock import monotonic_s, sleep_s

builtin = pytest.importorskip("cyclonedds.builtin")
core = pytest.importorskip("cyclonedds.core")
domains = pytest.importorskip("cyclonedds.domain")
idl = pytest.importorskip("cyclonedds.idl")
types = pytest.importorskip("cyclonedds.idl.types")
subscribing = pytest.importorskip("cyclonedds.sub")
topics = pytest.importorskip("cyclonedds.topic")


def struct(name: str, **fields: Any) -> Any:
    """A message type, written down here from the .msg files of ROS."""
    package, short = name.split("/")
    return idl.make_idl_struct(f"{short}_", f"{package}::msg::dds_::{short}_", fields)


TIME = struct("builtin_interfaces/Time", sec=types.int32, nanosec=types.uint32)
HEADER = struct("std_msgs/Header", stamp=TIME, frame_id=str)
THREE = dict.fromkeys("xyz", types.float64)
VECTOR, POINT = struct("geometry_msgs/Vector3", **THREE), struct("geometry_msgs/Point", **THREE)
TURN = struct("geometry_msgs/Quaternion", **THREE, w=types.float64)
NINE = types.array[types.float64, 9]
EVENTS = struct(
    "event_camera_msgs/EventPacket",
    header=HEADER,
    height=types.uint32,
    width=types.uint32,
    seq=types.uint64,
    time_base=types.uint64,
    encoding=str,
    is_bigendian=bool,
    events=types.sequence[types.uint8],
)
IMU = struct(
    "sensor_msgs/Imu",
    header=HEADER,
    orientation=TURN,
    orientation_covariance=NINE,
    angular_velocity=VECTOR,
    angular_velocity_covariance=NINE,
    linear_acceleration=VECTOR,
    linear_acceleration_covariance=NINE,
)
IMAGE = struct(
    "sensor_msgs/Image",
    header=HEADER,
    height=types.uint32,
    width=types.uint32,
    encoding=str,
    is_bigendian=types.uint8,
    step=types.uint32,
    data=types.sequence[types.uint8],
)
REGION = struct(
    "sensor_msgs/RegionOfInterest",
    **dict.fromkeys(("x_offset", "y_offset", "height", "width"), types.uint32),
    do_rectify=bool,
)
CAMERA_INFO = struct(
    "sensor_msgs/CameraInfo",
    header=HEADER,
    height=types.uint32,
    width=types.uint32,
    distortion_model=str,
    d=types.sequence[types.float64],
    k=NINE,
    r=NINE,
    p=types.array[types.float64, 12],
    binning_x=types.uint32,
    binning_y=types.uint32,
    roi=REGION,
)
POSE_STAMPED = struct(
    "geometry_msgs/PoseStamped",
    header=HEADER,
    pose=struct("geometry_msgs/Pose", position=POINT, orientation=TURN),
)
TRANSFORM = struct(
    "geometry_msgs/TransformStamped",
    header=HEADER,
    child_frame_id=str,
    transform=struct("geometry_msgs/Transform", translation=VECTOR, rotation=TURN),
)
TF = struct("tf2_msgs/TFMessage", transforms=types.sequence[TRANSFORM])
CLOCK = struct("rosgraph_msgs/Clock", clock=TIME)

KINDS = {
    "events": EVENTS,
    "imu": IMU,
    "image_raw": IMAGE,
    "camera_info": CAMERA_INFO,
    "pose": POSE_STAMPED,
    "/tf": TF,
    "/tf_static": TF,
    "/clock": CLOCK,
}


class Ears:
    """Readers as a node of ROS has them: best effort, but for tf; of any depth."""

    def __init__(
        self,
        domain_id: int,
        path: str,
        names: tuple[str, ...],
        reliable: bool = False,
        depth: int = 10_000,
    ) -> None:
        self._participant = domains.DomainParticipant(domain_id)
        self._readers = {}
        for name in names:
            policy = core.Policy.Reliability
            firm = reliable or name in ("/tf", "/tf_static")
            durability = core.Policy.Durability
            quality = core.Qos(
                policy.Reliable(10**8) if firm else policy.BestEffort,
                durability.TransientLocal if name == "/tf_static" else durability.Volatile,
                core.Policy.History.KeepLast(depth),
            )
            where = name if name[0] == "/" else f"{path}/{name}"
            topic = topics.Topic(self._participant, f"rt{where}", KINDS[name], qos=quality)
            self._readers[name] = subscribing.DataReader(self._participant, topic, qos=quality)

    def take(self, name: str) -> list[Any]:
        """What has come; inside one process it is there once it is written."""
        return list(self._readers[name].take(10_000))


def writers(domain_id: int, names: set[str]) -> dict[str, tuple[bool, bool]]:
    """Topic -> whether its writer is reliable, and whether it is transient local, as announced."""
    participant = domains.DomainParticipant(domain_id)
    reader = builtin.BuiltinDataReader(participant, builtin.BuiltinTopicDcpsPublication)
    found, ends_s = {}, monotonic_s() + 30
    while names - found.keys() and monotonic_s() < ends_s:
        for one in reader.take(1000):
            reliable = isinstance(
                one.qos[core.Policy.Reliability], core.Policy.Reliability.Reliable
            )
            kept = one.qos[core.Policy.Durability] == core.Policy.Durability.TransientLocal
            found[one.topic_name.removeprefix("rt")] = reliable, kept
        sleep_s(0.01)
    return {name: found[name] for name in names & found.keys()}


def ns(time: Any) -> int:
    return int(time.sec) * 10**9 + int(time.nanosec)
