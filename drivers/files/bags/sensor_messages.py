"""Images, IMU samples and calibration as the messages of sensor_msgs, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from evs.drivers.files.bags.messages import BadMessageError
from evs.msgs import Frame, ImuSamples, StreamInfo, empty_imu
from evs.msgs.frame import FRAME_ENCODINGS

IMAGE = "sensor_msgs/msg/Image"
EXPOSURE = "std_msgs/msg/Int32"
SAMPLE = "sensor_msgs/msg/Imu"
INFO = "sensor_msgs/msg/CameraInfo"

TOPICS = {IMAGE: "image_raw", EXPOSURE: "exposure", SAMPLE: "imu", INFO: "camera_info"}
"""message type -> topic in the camera's namespace; exposure, in us, comes before its image"""

_GREY = FRAME_ENCODINGS | {"8UC1": FRAME_ENCODINGS["mono8"], "16UC1": FRAME_ENCODINGS["mono16"]}


def image_message(store: Any, header: Any, frame: Frame) -> Any:
    """The Image message of a frame, stamped with the start of the exposure."""
    pixels = np.ascontiguousarray(frame.pixels)
    (encoding,) = (name for name, dtype in FRAME_ENCODINGS.items() if dtype == pixels.dtype)
    return store.types[IMAGE](
        header=header,
        height=frame.height,
        width=frame.width,
        encoding=encoding,
        is_bigendian=0,
        step=frame.width * pixels.itemsize,
        data=pixels.view(np.uint8).reshape(-1),
    )


def frame_of(message: Any, seq: int, camera: str, exposure_us: int) -> Frame | None:
    """The frame of an Image message; None for colour. BadMessageError: its sizes do not agree."""
    dtype = _GREY.get(message.encoding)
    if dtype is None:
        return None
    if message.is_bigendian and dtype.itemsize > 1:
        dtype = dtype.newbyteorder(">")
    height, width, step = int(message.height), int(message.width), int(message.step)
    if not (height and width and step >= width * dtype.itemsize):
        raise BadMessageError(f"an image of {width} x {height} px has rows of {step} bytes")
    if len(message.data) < height * step:
        raise BadMessageError(f"an image of {width} x {height} px has {len(message.data)} bytes")
    rows = np.ascontiguousarray(message.data[: height * step]).reshape(height, step)
    pixels = np.ascontiguousarray(rows[:, : width * dtype.itemsize]).view(dtype)
    begin, end = stamp_us(message), stamp_us(message) + exposure_us
    native: Any = pixels.astype(dtype.newbyteorder("="), copy=False)
    return Frame(seq, begin, begin, end, end, native, camera)


def sample_message(store: Any, header: Any, sample: Any) -> Any:
    """The Imu message of a sample; its orientation is marked as unknown."""
    types = store.types
    turn, force = (
        types["geometry_msgs/msg/Vector3"](*(float(axis) for axis in sample[name]))
        for name in ("angular_velocity", "acceleration")
    )
    unknown = np.zeros(9)
    unknown[0] = -1.0
    return types[SAMPLE](
        header=header,
        orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        orientation_covariance=unknown,
        angular_velocity=turn,
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=force,
        linear_acceleration_covariance=np.zeros(9),
    )


def sample_of(message: Any) -> ImuSamples:
    """(1,) the sample of an Imu message; the temperature, which it does not have, is 0."""
    sample = empty_imu(1)
    sample["t"] = stamp_us(message)
    for name, vector in (
        ("angular_velocity", message.angular_velocity),
        ("acceleration", message.linear_acceleration),
    ):
        sample[name] = (vector.x, vector.y, vector.z)
    if not all(np.isfinite(sample[name]).all() for name in ("angular_velocity", "acceleration")):
        raise BadMessageError("an IMU sample is not finite")
    return sample


def info_message(store: Any, header: Any, stream: StreamInfo, ros: int) -> Any | None:
    """The CameraInfo message of a stream; None where the stream has no calibration."""
    info = stream.camera_info
    if not {"k", "r", "p", "d"} <= set(info):
        return None
    numbers = {name: np.array(info[name], np.float64) for name in "dkrp"}
    if ros == 1:
        numbers = {name.upper(): value for name, value in numbers.items()}
    return store.types[INFO](
        header=header,
        height=stream.height,
        width=stream.width,
        distortion_model=str(info.get("distortion_model", "plumb_bob")),
        binning_x=0,
        binning_y=0,
        roi=store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
        **numbers,
    )


def stamp_us(message: Any) -> int:
    """The time stamp of a message's header, us."""
    return int(message.header.stamp.sec) * 1_000_000 + int(message.header.stamp.nanosec) // 1000
