"""EventPacket: the events of one tick (or more) of one camera. The only door to msgpack.

On the wire: `topic | msgpack header | raw frame`. The header's field names follow ROS's
event_camera_msgs/EventPacket; the raw frame is the events' own bytes, 16 each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np

from evs.msgs.errors import EvsError
from evs.msgs.event import EVENT_DTYPE, Events, empty_events

ENCODING = "evs16"
"""Name of the raw frame's encoding: an array of EVENT_DTYPE, little-endian."""

MAX_HEADER_BYTES = 64 * 1024
"""A larger header is refused before it is parsed."""


class MessageError(EvsError):
    """Bytes from outside that are not a packet of ours."""


@dataclass(frozen=True)
class EventPacket:
    """Events of the interval (time_base_us, time_end_us] of one camera.

    A packet may be empty: it still says that time has passed.
    """

    seq: int
    """Counts this camera's packets from 0, without gaps."""
    time_base_us: int
    """Simulated time at which the interval begins, us; events lie after it."""
    time_end_us: int
    """Simulated time at which the interval ends, us; events lie at or before it."""
    width: int
    """Sensor width, px."""
    height: int
    """Sensor height, px."""
    events: Events = field(default_factory=empty_events)
    """(n,) EVENT_DTYPE, sorted by t."""
    camera: str = "camera"
    """Name of the camera that saw them."""

    def __len__(self) -> int:
        return len(self.events)


def encode(packet: EventPacket) -> tuple[bytes, memoryview]:
    """Out: (msgpack header, raw frame of 16 n bytes, not copied where it is contiguous)."""
    header = {
        "seq": packet.seq,
        "time_base": packet.time_base_us,
        "time_end": packet.time_end_us,
        "encoding": ENCODING,
        "is_bigendian": False,
        "width": packet.width,
        "height": packet.height,
        "camera": packet.camera,
    }
    frame = np.ascontiguousarray(packet.events).view(np.uint8).reshape(-1)
    return packb(header), memoryview(frame)


def decode(header: bytes, frame: Any) -> EventPacket:
    """The packet of a header and any buffer with its raw frame.

    The events share the buffer's memory. Raises MessageError where the bytes do not fit the format.
    """
    fields = unpackb(header)
    if fields.get("encoding") != ENCODING:
        raise MessageError(f"packet encoding {fields.get('encoding')!r} is not {ENCODING!r}")
    if memoryview(frame).nbytes % EVENT_DTYPE.itemsize:
        raise MessageError(f"raw frame of {memoryview(frame).nbytes} bytes is not whole events")
    try:
        return EventPacket(
            seq=_integer(fields, "seq"),
            time_base_us=_integer(fields, "time_base"),
            time_end_us=_integer(fields, "time_end"),
            width=_integer(fields, "width"),
            height=_integer(fields, "height"),
            events=np.frombuffer(frame, EVENT_DTYPE),
            camera=str(fields.get("camera", "camera")),
        )
    except KeyError as missing:
        raise MessageError(f"packet header lacks {missing}") from None


def packb(fields: dict[str, Any]) -> bytes:
    """msgpack bytes of a map of plain values."""
    packed: bytes = msgpack.packb(fields, use_bin_type=True)
    return packed


def unpackb(header: bytes) -> dict[str, Any]:
    """The map in a msgpack header; MessageError if it is too large, torn or not a map."""
    if len(header) > MAX_HEADER_BYTES:
        raise MessageError(f"header of {len(header)} bytes is over {MAX_HEADER_BYTES}")
    try:
        fields = msgpack.unpackb(header, raw=False, strict_map_key=True)
    except (ValueError, msgpack.exceptions.UnpackException) as reason:
        raise MessageError(f"header is not msgpack: {reason}") from None
    if not isinstance(fields, dict):
        raise MessageError(f"header is a {type(fields).__name__}, not a map")
    return fields


def _integer(fields: dict[str, Any], name: str) -> int:
    value = fields[name]
    if not isinstance(value, int) or isinstance(value, bool):
        raise MessageError(f"header field {name!r} is {value!r}, not an integer")
    return value
