"""Messages in bags: dvs_msgs/EventArray as bytes; images, IMU samples, calibration and poses.

An EventArray is converted as a whole, as ROS 1 and ROS 2 write it. Both begin with the header (ROS
1: a sequence number first), height, width and the number of events; strings are zero-terminated in
ROS 2 only. Then, an event: x u16, y u16, seconds 4 bytes, nanoseconds u32, polarity u8. ROS 1 packs
these 13 bytes; ROS 2 aligns each number to its size, so that seconds lie on multiples of 4 and all
events but the first begin 2 bytes before one of 16.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.drivers.files.bags.library import typestore
from evs.drivers.files.bags.names import FrameIds
from evs.msgs import Events, Frame, ImuSamples, Pose, StreamInfo, empty_imu, make_events
from evs.msgs.frame import FRAME_ENCODINGS

_ROS1 = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("p", "u1")])
_ROS2 = np.dtype(
    {
        "names": ["y", "s", "ns", "p", "next_x"],
        "formats": ["<u2", "<u4", "<u4", "u1", "<u2"],
        "offsets": [0, 4, 8, 12, 14],
        "itemsize": 16,
    }
)
"""from an event's y to the next one's x; the first event has x and y where later ones have y"""

_CDR = b"\x00\x01\x00\x00"
_SECOND_US = 1_000_000
MAX_FRAME_ID = 1 << 16


class BadMessageError(Exception):
    """The bytes are not a message of this type."""


@dataclass(frozen=True)
class ArrayMessage:
    """The content of an EventArray."""

    frame_id: str
    height: int
    width: int
    events: Events


def array_bytes(
    events: Events, ros: int, seq: int, frame_id: str, height: int, width: int
) -> bytes:
    """Encode events, (n,), as a message; its time stamp is the first event's."""
    first = int(events["t"][0]) if len(events) else 0
    stamp = divmod(first, _SECOND_US)
    name = frame_id.encode()
    seconds, rest = np.divmod(events["t"], _SECOND_US)
    if ros == 1:
        head = struct.pack("<IIII", seq & 0xFFFFFFFF, stamp[0], stamp[1] * 1000, len(name)) + name
        rows = np.empty(len(events), _ROS1)
        rows["x"], rows["y"] = events["x"], events["y"]
        rows["s"], rows["ns"], rows["p"] = seconds, rest * 1000, events["p"]
        return head + struct.pack("<III", height, width, len(events)) + rows.tobytes()
    name += b"\0"
    head = struct.pack("<III", stamp[0], stamp[1] * 1000, len(name)) + name
    head += bytes(-len(head) % 4) + struct.pack("<III", height, width, len(events))
    aligned = np.zeros(len(events), _ROS2)
    aligned["y"][1:], aligned["next_x"][:-1] = events["y"][1:], events["x"][1:]
    aligned["s"], aligned["ns"], aligned["p"] = seconds, rest * 1000, events["p"]
    body = bytearray(aligned.tobytes())
    if body:
        struct.pack_into("<HH", body, 0, int(events["x"][0]), int(events["y"][0]))
    # nothing follows the last polarity
    return _CDR + head + bytes(body[:-3])


def parse_array(data: bytes, ros: int) -> ArrayMessage:
    """Decode a message; BadMessageError where the bytes are not one, or are big-endian."""
    try:
        if ros == 1:
            length = struct.unpack_from("<12xI", data)[0]
            at = 16 + length
            name = data[16:at]
        else:
            if data[:2] != _CDR[:2]:
                raise BadMessageError("it is not little-endian CDR")
            data = data[4:]
            length = struct.unpack_from("<8xI", data)[0]
            at = 12 + length
            name = data[12:at].rstrip(b"\0")
            at += -at % 4
        height, width, count = struct.unpack_from("<III", data, at)
    except struct.error:
        raise BadMessageError("its header is torn") from None
    at += 12
    size = count * _ROS1.itemsize if ros == 1 else max(0, 16 * count - 3)
    if length > MAX_FRAME_ID or len(data) - at < size:
        raise BadMessageError(f"it states {count} events, which do not fit into it")
    if ros == 1:
        rows = np.frombuffer(data, _ROS1, count, at)
        x, y = rows["x"], rows["y"]
    else:
        rows = np.frombuffer(data[at : at + size] + bytes(3), _ROS2, count)
        y, x = rows["y"].copy(), np.roll(rows["next_x"], 1)
        if count:
            x[0], y[0] = struct.unpack_from("<HH", data, at)
    t = rows["s"].astype(np.int64) * _SECOND_US + rows["ns"] // 1000
    # a coordinate that is too large becomes one outside every sensor
    x, y = np.minimum(x, 0x7FFF), np.minimum(y, 0x7FFF)
    events = make_events(t, x, y, rows["p"] > 0)
    return ArrayMessage(name.decode(errors="replace"), height, width, events)


def deserialised(data: bytes, kind: str, ros: int) -> Any:
    """Decode a message of a type that the library knows; BadMessageError where it cannot be."""
    store = typestore(ros)
    take = store.deserialize_ros1 if ros == 1 else store.deserialize_cdr
    try:
        return take(data, kind)
    except Exception as reason:  # damaged bytes make it raise a dozen kinds
        raise BadMessageError(f"{type(reason).__name__} in a message") from None


IMAGE = "sensor_msgs/msg/Image"
EXPOSURE = "std_msgs/msg/Int32"
SAMPLE = "sensor_msgs/msg/Imu"
INFO = "sensor_msgs/msg/CameraInfo"
POSE = "geometry_msgs/msg/PoseStamped"

TOPICS = {
    IMAGE: "image_raw",
    EXPOSURE: "exposure",
    SAMPLE: "imu",
    INFO: "camera_info",
    POSE: "pose",
}
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


def info_message(store: Any, header: Any, stream: StreamInfo, ros: int) -> Any:
    """The CameraInfo message of a stream; without a calibration, all is zero but the size."""
    info = stream.camera_info if is_calibrated(stream) else _UNCALIBRATED
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


_UNCALIBRATED = {"distortion_model": "", "d": [], "k": [0.0] * 9, "r": [0.0] * 9, "p": [0.0] * 12}
"""as CameraInfo.msg asks of an uncalibrated camera"""


def is_calibrated(stream: StreamInfo) -> bool:
    """Whether a stream has a calibration."""
    return {"k", "r", "p", "d"} <= set(stream.camera_info)


OPTICAL_IN_LINK = (-0.5, 0.5, -0.5, 0.5)
"""unit quaternion (x, y, z, w) that turns the optical frame (x right, y down, z forward) into the
camera's body (x forward, y left, z up)"""


def pose_message(store: Any, header: Any, pose: Pose) -> Any:
    """The PoseStamped message of the optical frame; the header's frame is the world's."""
    types = store.types
    place = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](*map(float, pose.position)),
        orientation=types["geometry_msgs/msg/Quaternion"](*map(float, pose.orientation)),
    )
    return types[POSE](header=header, pose=place)


def link_transform(store: Any, header: Any, frames: FrameIds, pose: Pose) -> Any:
    """The TransformStamped message of the camera's link; the header's frame is the world's."""
    turn = link_orientation(pose.orientation)
    return _transform(store, header, frames.link, turn, pose.position)


def static_transforms(store: Any, header: Any, frames: FrameIds, imu: bool) -> list[Any]:
    """The TransformStamped messages of a camera's frames in its link.

    Args:
        store: The message types.
        header: Its frame is the link.
        frames: The camera's.
        imu: Whether it has an IMU.
    """
    children = [frames.camera]
    # a frame has one transform
    if imu and frames.imu != frames.camera:
        children.append(frames.imu)
    return [_transform(store, header, child, OPTICAL_IN_LINK) for child in children]


def link_orientation(optical: tuple[float, float, float, float]) -> tuple[float, ...]:
    """The orientation of the camera's link.

    Args:
        optical: Unit quaternion (x, y, z, w) that turns the optical frame into the world's.

    Returns:
        The same of the link: the product with the inverse of OPTICAL_IN_LINK.
    """
    x, y, z, w = optical
    i, j, k, r = OPTICAL_IN_LINK
    return (
        x * r - w * i - y * k + z * j,
        y * r - w * j - z * i + x * k,
        z * r - w * k - x * j + y * i,
        w * r + x * i + y * j + z * k,
    )


def _transform(
    store: Any,
    header: Any,
    child: str,
    turn: tuple[float, ...],
    position: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> Any:
    """A TransformStamped message: turn (x, y, z, w) and place, m, of a child in its parent."""
    types = store.types
    transform = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](*map(float, position)),
        rotation=types["geometry_msgs/msg/Quaternion"](*map(float, turn)),
    )
    kind = types["geometry_msgs/msg/TransformStamped"]
    return kind(header=header, child_frame_id=child, transform=transform)


def stamp_us(message: Any) -> int:
    """The time stamp of a message's header, us."""
    return int(message.header.stamp.sec) * 1_000_000 + int(message.header.stamp.nanosec) // 1000
