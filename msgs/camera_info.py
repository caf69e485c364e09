"""CameraInfo: the calibration of a camera, as in ROS's sensor_msgs/CameraInfo.

On the wire: `topic | msgpack header`, see docs/reference/wire.md.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from evs.msgs.header_fields import MAX_PIXELS, MessageError, integer, name, numbers
from evs.msgs.packet import packb, unpackb
from evs.msgs.stream import StreamInfo


@dataclass(frozen=True)
class CameraInfo:
    """Constant facts of a camera's picture."""

    camera: str
    """Name of the camera."""
    width: int
    """px."""
    height: int
    """px."""
    distortion_model: str
    """ROS's name, as in plumb_bob; none for a camera that has none."""
    d: tuple[float, ...]
    """(n,) coefficients of the model."""
    k: tuple[float, ...]
    """(9,) intrinsic matrix, by rows."""
    r: tuple[float, ...]
    """(9,) rectification matrix, by rows."""
    p: tuple[float, ...]
    """(12,) projection matrix, by rows."""


def camera_info_of(stream: StreamInfo) -> CameraInfo | None:
    """The calibration in a StreamInfo; None where it holds none (a recording may lack it).

    Raises MessageError where it holds something else.
    """
    if not stream.camera_info:
        return None
    return _from_fields(_lists({**stream.camera_info, "camera": stream.camera}))


def encode_camera_info(info: CameraInfo) -> bytes:
    """The msgpack header. Raises MessageError for values that do not fit into one."""
    fields = _lists(asdict(info))
    _from_fields(fields)
    return packb(fields)


def decode_camera_info(header: bytes) -> CameraInfo:
    """The calibration in a header. Raises MessageError where the bytes do not fit the format."""
    return _from_fields(unpackb(header))


def _lists(fields: dict[str, Any]) -> dict[str, Any]:
    return {
        key: [float(one) for one in value] if isinstance(value, (list, tuple)) else value
        for key, value in fields.items()
    }


def _from_fields(fields: dict[str, Any]) -> CameraInfo:
    model = fields.get("distortion_model")
    # ROS leaves it empty where there is no model
    if model != "":
        name(fields, "distortion_model")
    if not isinstance(model, str):
        raise MessageError("header field 'distortion_model' is not a name")
    return CameraInfo(
        camera=name(fields, "camera"),
        width=integer(fields, "width", 1, MAX_PIXELS),
        height=integer(fields, "height", 1, MAX_PIXELS),
        distortion_model=model,
        d=numbers(fields, "d", 0, 64),
        k=numbers(fields, "k", 9, 9),
        r=numbers(fields, "r", 9, 9),
        p=numbers(fields, "p", 12, 12),
    )
