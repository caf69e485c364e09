"""event_camera_msgs/EventPacket as the bytes of its CDR, without a library of ROS."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evs.drivers.ros2.event_messages import EventMessage


def packet_message(
    message: EventMessage, seq: int, width: int, height: int, encoding: str, frame_id: str
) -> bytes:
    """Pack one message.

    Args:
        message: The events and their times.
        seq: Number of the message.
        width: Of the sensor, px.
        height: Of the sensor, px.
        encoding: As ROS's codecs call it.
        frame_id: Of the camera.

    Returns:
        Little-endian CDR, with its header of four bytes.
    """
    seconds, rest = divmod(message.first_us, 1_000_000)
    body = struct.pack("<iI", seconds, 1000 * rest) + _text(frame_id)
    body = _aligned(body, 4) + struct.pack("<II", height, width)
    body = _aligned(body, 8) + struct.pack("<QQ", seq, message.time_base_ns) + _text(encoding)
    # is_bigendian, then the events, a sequence of bytes
    body = _aligned(body + b"\0", 4) + struct.pack("<I", len(message.data))
    return b"".join((b"\0\1\0\0", body, message.data))


def _text(text: str) -> bytes:
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def _aligned(body: bytes, size: int) -> bytes:
    return body + bytes(-len(body) % size)
