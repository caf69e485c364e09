"""dvs_msgs/EventArray as bytes and back, a whole array at once, as ROS 1 and ROS 2 write it.

Both begin with the header (ROS 1: a sequence number first), height, width and the number of events;
strings are zero-terminated in ROS 2 only. Then, an event: x u16, y u16, seconds 4 bytes,
nanoseconds u32, polarity u8. ROS 1 packs these 13 bytes; ROS 2 aligns each number to its size, so
that seconds lie on multiples of 4 and all events but the first begin 2 bytes before one of 16.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.drivers.files.bags.library import typestore
from evs.msgs import Events, make_events

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
    # what is too large for a pixel is put beside every sensor
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
