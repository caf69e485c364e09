"""The data of a camera as messages of ROS 2, each as the bytes of its CDR."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from evs.drivers.files.bags.library import PACKET, TRANSFORMS, typestore
from evs.drivers.files.bags.messages import (
    IMAGE,
    INFO,
    POSE,
    SAMPLE,
    image_message,
    info_message,
    is_calibrated,
    link_transform,
    pose_message,
    sample_message,
    static_transforms,
)
from evs.drivers.files.bags.names import FrameIds
from evs.drivers.ros2.event_messages import EventMessage
from evs.drivers.ros2.names import CLOCK
from evs.msgs import Frame, Pose, StreamInfo
from evs.msgs.imu import empty_imu

_SECOND_US = 1_000_000


class Messages:
    """Makes the messages of one camera. Stamps are simulated time."""

    def __init__(self, stream: StreamInfo, frames: FrameIds, world_frame: str) -> None:
        """Prepare the messages of a camera.

        Args:
            stream: The camera's stream.
            frames: Names of its frames.
            world_frame: Name of the world's frame.
        """
        self._stream, self._frames, self._world_frame = stream, frames, world_frame
        self._store = typestore(2)
        self._seq = 0
        self.has_info = stream.frames or is_calibrated(stream)
        """whether there is a camera_info: with each image, or of a calibrated camera"""

    def events(self, message: EventMessage, encoding: str) -> bytes:
        """event_camera_msgs/EventPacket; its stamp is the first event's."""
        self._seq += 1
        stream = self._stream
        made = self._store.types[PACKET](
            header=self._header(message.first_us),
            height=stream.height,
            width=stream.width,
            seq=self._seq - 1,
            time_base=message.time_base_ns,
            encoding=encoding,
            is_bigendian=False,
            events=np.frombuffer(message.data, np.uint8),
        )
        return self._bytes(made, PACKET)

    def image(self, frame: Frame) -> bytes:
        """sensor_msgs/Image; its stamp is the exposure's begin."""
        header = self._header(frame.exposure_begin_us)
        return self._bytes(image_message(self._store, header, frame), IMAGE)

    def info(self, t_us: int) -> bytes:
        """sensor_msgs/CameraInfo; without a calibration it is zero but for the size."""
        return self._bytes(info_message(self._store, self._header(t_us), self._stream, 2), INFO)

    def sample(self, sample: Any) -> bytes:
        """sensor_msgs/Imu of one sample."""
        header = self._header(int(sample["t"]), self._frames.imu)
        return self._bytes(sample_message(self._store, header, sample), SAMPLE)

    def pose(self, pose: Pose) -> bytes:
        """geometry_msgs/PoseStamped of the optical frame, in the world's."""
        header = self._header(pose.t_us, self._world_frame)
        return self._bytes(pose_message(self._store, header, pose), POSE)

    def transform(self, pose: Pose) -> bytes:
        """tf2_msgs/TFMessage: the camera's link in the world's frame."""
        header = self._header(pose.t_us, self._world_frame)
        moved = link_transform(self._store, header, self._frames, pose)
        return self._bytes(self._store.types[TRANSFORMS](transforms=[moved]), TRANSFORMS)

    def static_transforms(self, t_us: int) -> list[Any]:
        """geometry_msgs/TransformStamped of the frames that stay where they are in the link."""
        header = self._header(t_us, self._frames.link)
        return static_transforms(self._store, header, self._frames, self._stream.imu)

    def _header(self, t_us: int, frame_id: str | None = None) -> Any:
        name = self._frames.camera if frame_id is None else frame_id
        return self._store.types["std_msgs/msg/Header"](stamp=_time(t_us), frame_id=name)

    def _bytes(self, message: Any, kind: str) -> bytes:
        return _padded(self._store.serialize_cdr(message, kind))


@cache
def rehearse() -> None:
    """Make one message of each type: the library generates code for a type at its first use.

    That takes 20 ms in all, too long for the first tick.
    """
    one = Messages(StreamInfo(1, 1), FrameIds("", "", ""), "")
    pose = Pose(0, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    one.events(EventMessage(0, 0, 0, b"", 0), "")
    one.image(Frame(0, 0, 0, 0, 0, np.zeros((1, 1), np.uint8)))
    one.info(0)
    one.sample(empty_imu(1)[0])
    one.pose(pose)
    one.transform(pose)
    clock_message(0)


def static_message(transforms: list[Any]) -> bytes:
    """tf2_msgs/TFMessage of the transforms of all cameras: /tf_static keeps one message."""
    store = typestore(2)
    message = store.types[TRANSFORMS](transforms=transforms)
    return _padded(store.serialize_cdr(message, TRANSFORMS))


def clock_message(t_us: int) -> bytes:
    """rosgraph_msgs/Clock."""
    store = typestore(2)
    return _padded(store.serialize_cdr(store.types[CLOCK](clock=_time(t_us)), CLOCK))


def _padded(data: memoryview) -> bytes:
    """Padded to whole words of 4 bytes, as DDS requires."""
    return b"".join((data, bytes(-len(data) % 4)))


def _time(t_us: int) -> Any:
    seconds, rest = divmod(t_us, _SECOND_US)
    kind = typestore(2).types["builtin_interfaces/msg/Time"]
    return kind(sec=seconds, nanosec=rest * 1000)
