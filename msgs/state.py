"""State: the latest of everything in one message, for subscribers that need only that.

On the wire it is one part, `state/` and a msgpack map, because ZeroMQ keeps only the latest message
of a connection (CONFLATE) if messages have one part. See docs/reference/wire.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from evs.msgs.header_fields import MAX_INT64, MessageError, boolean, integer, name, numbers, shown
from evs.msgs.packet import packb, unpackb
from evs.msgs.status import MAX_CAMERAS
from evs.msgs.topics import STATE_PREFIX

MAX_STATE_BYTES = 256 * 1024
"""A larger one is refused before it is parsed."""


@dataclass(frozen=True)
class CameraState:
    """The latest values of one camera."""

    camera: str
    """Name of the camera."""
    seq: int
    """Number of its last packet; -1 before the first."""
    packets: int
    """Packets so far, sent or not."""
    events: int
    """Events in them."""
    end: bool
    """True: the stream is over."""
    position: tuple[float, ...] = ()
    """(3,) m, of the last pose; empty: none is known."""
    orientation: tuple[float, ...] = ()
    """(4,) quaternion x, y, z, w, as in Pose; empty: none is known."""
    acceleration: tuple[float, ...] = ()
    """(3,) m/s^2, of the last IMU sample; empty: none is known."""
    angular_velocity: tuple[float, ...] = ()
    """(3,) rad/s, of the last IMU sample; empty: none is known."""


@dataclass(frozen=True)
class State:
    """The latest values of a bus."""

    t_us: int
    """Simulated time, us."""
    cameras: tuple[CameraState, ...]

    def of(self, camera: str) -> CameraState:
        """The state of one camera; KeyError if it has none of that name."""
        return {one.camera: one for one in self.cameras}[camera]


_VECTORS = {"position": 3, "orientation": 4, "acceleration": 3, "angular_velocity": 3}


def encode_state(state: State) -> bytes:
    """The message. Raises MessageError for values that do not fit into one."""
    cameras = [
        {
            "camera": one.camera,
            "seq": one.seq,
            "packets": one.packets,
            "events": one.events,
            "end": one.end,
            **{key: list(getattr(one, key)) for key in _VECTORS},
        }
        for one in state.cameras
    ]
    return STATE_PREFIX + packb({"t": state.t_us, "cameras": cameras}, MAX_STATE_BYTES)


def decode_state(message: bytes) -> State:
    """The state of a message. Raises MessageError where the bytes do not fit the format."""
    if not message.startswith(STATE_PREFIX):
        raise MessageError(f"message does not begin with {STATE_PREFIX.decode()!r}")
    fields = unpackb(message[len(STATE_PREFIX) :], MAX_STATE_BYTES)
    cameras = fields.get("cameras")
    if not isinstance(cameras, list) or len(cameras) > MAX_CAMERAS:
        raise MessageError(f"field 'cameras' is {shown(cameras)}, not up to {MAX_CAMERAS} cameras")
    return State(
        integer(fields, "t", -MAX_INT64, MAX_INT64), tuple(_camera(one) for one in cameras)
    )


def _camera(fields: Any) -> CameraState:
    if not isinstance(fields, dict):
        raise MessageError(f"a camera's state is {shown(fields)}, not a map")
    vectors = {}
    for key, count in _VECTORS.items():
        vectors[key] = numbers(fields, key, 0, count)
        if len(vectors[key]) not in (0, count):
            raise MessageError(f"field {key!r} holds {len(vectors[key])} numbers, not {count}")
    return CameraState(
        camera=name(fields, "camera"),
        seq=integer(fields, "seq", -1, MAX_INT64),
        packets=integer(fields, "packets", 0, MAX_INT64),
        events=integer(fields, "events", 0, MAX_INT64),
        end=boolean(fields, "end"),
        **vectors,
    )
