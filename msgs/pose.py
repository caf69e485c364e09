"""Pose and Clock: where a camera is, and what time it is in the simulation.

On the wire both are `topic | msgpack header`, see docs/reference/wire.md.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from evs.msgs.header_fields import MAX_INT64, MessageError, integer, name, numbers
from evs.msgs.packet import packb, plain_integers, unpackb


@dataclass(frozen=True)
class Pose:
    """The pose of a camera at one instant in the world's frame, in ROS's convention."""

    seq: int
    """Counts this camera's poses from 0, sent or not."""
    t_us: int
    """Simulated time, us."""
    position: tuple[float, float, float]
    """m."""
    orientation: tuple[float, float, float, float]
    """Unit quaternion (x, y, z, w) that turns the optical frame (x right, y down, z forward) into
    the world's."""
    camera: str = "camera"
    """Name of the camera."""


@dataclass(frozen=True)
class Clock:
    """Simulated time: every event up to it has been sent."""

    t_us: int
    """us."""


def encode_pose(pose: Pose) -> bytes:
    """The msgpack header of a pose. Raises MessageError for values that do not fit into one."""
    fields = asdict(pose)
    fields["t"] = fields.pop("t_us")
    fields["position"] = [float(value) for value in pose.position]
    fields["orientation"] = [float(value) for value in pose.orientation]
    fields = plain_integers(fields)
    _pose(fields)
    return packb(fields)


def decode_pose(header: bytes) -> Pose:
    """The pose of a msgpack header. Raises MessageError where the bytes do not fit the format."""
    return _pose(unpackb(header))


def encode_clock(clock: Clock) -> bytes:
    """The msgpack header of a clock."""
    fields = plain_integers({"t": clock.t_us})
    _clock(fields)
    return packb(fields)


def decode_clock(header: bytes) -> Clock:
    """The clock of a msgpack header. Raises MessageError where the bytes do not fit the format."""
    return _clock(unpackb(header))


def _clock(fields: dict[str, Any]) -> Clock:
    return Clock(integer(fields, "t", -MAX_INT64, MAX_INT64))


def _pose(fields: dict[str, Any]) -> Pose:
    x, y, z = numbers(fields, "position", 3, 3)
    i, j, k, w = numbers(fields, "orientation", 4, 4)
    # in doubles a unit quaternion is one to 1e-15; what is off by more is another thing
    if abs(i * i + j * j + k * k + w * w - 1.0) > 1e-6:
        raise MessageError("header field 'orientation' is no unit quaternion")
    return Pose(
        seq=integer(fields, "seq", 0, MAX_INT64),
        t_us=integer(fields, "t", -MAX_INT64, MAX_INT64),
        position=(x, y, z),
        orientation=(i, j, k, w),
        camera=name(fields, "camera"),
    )
