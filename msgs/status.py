"""Status: how much a camera has sent so far, so that subscribers can count what they missed.

A gap in seq shows a lost packet only once a later one arrives. The status repeats the last seq, so
that the loss of the last packets is seen too. On the wire: `topic | msgpack header`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

from evs.msgs.header_fields import (
    MAX_INT64,
    MAX_PIXELS,
    MessageError,
    boolean,
    integer,
    name,
    shown,
)
from evs.msgs.packet import packb, unpackb

STATUS_PERIOD_US = 100_000
"""Simulated time between two statuses of a camera, us."""

MAX_CAMERAS = 200
"""Most cameras on one bus: their names have to fit into a header."""

_PACE_COUNTS = ("late_us", "worst_late_us", "slipped_us", "slips")

MAX_TOPICS = 32
"""Most topics whose last seq a status holds; ours are fewer."""


@dataclass(frozen=True)
class Pace:
    """How well a run that follows the wall clock keeps up with it."""

    speed: float
    """Simulated seconds per second of the wall clock."""
    late_us: int
    """How far the latest tick was behind its time, us of the wall clock."""
    worst_late_us: int
    """The most of any tick so far."""
    slipped_us: int
    """By how much simulated time has slipped behind the wall clock so far, for good, us."""
    slips: int
    """In how many ticks."""


@dataclass(frozen=True)
class Status:
    """Totals of one camera's stream up to now, and the constant facts of the stream."""

    camera: str
    """Name of the camera."""
    seq: int
    """The last packet's seq; -1 before the first packet."""
    packets: int
    """Packets so far, sent or not (there may have been no subscriber)."""
    events: int
    """Events in them."""
    time_end_us: int
    """Simulated time at the end of the last packet, us."""
    end: bool
    """True: the stream is over, no packet follows."""
    width: int
    """Sensor width, px."""
    height: int
    """Sensor height, px."""
    sensor: str
    """Name of the sensor preset."""
    tick_us: int
    """Length of a tick, us."""
    seed: int
    """Seed of the sensor's random numbers."""
    cameras: tuple[str, ...] = ()
    """Every camera on this bus, this one included."""
    last: dict[str, int] = field(default_factory=dict)
    """Topic -> seq of this camera's last message on it: frames, imu, pose, ground_truth."""
    pace: Pace | None = None
    """How the run keeps its pace; None: it does not follow the wall clock."""


def encode_status(status: Status) -> bytes:
    """The msgpack header of a status. Raises MessageError for values that do not fit into one."""
    fields = asdict(status)
    fields["time_end"] = fields.pop("time_end_us")
    fields["cameras"] = list(status.cameras)
    if status.pace is None:
        del fields["pace"]
    _from_fields(fields)
    return packb(fields)


def decode_status(header: bytes) -> Status:
    """The status of a msgpack header. Raises MessageError where the bytes do not fit the format."""
    return _from_fields(unpackb(header))


def _from_fields(fields: dict[str, Any]) -> Status:
    return Status(
        camera=name(fields, "camera"),
        seq=integer(fields, "seq", -1, MAX_INT64),
        packets=integer(fields, "packets", 0, MAX_INT64),
        events=integer(fields, "events", 0, MAX_INT64),
        time_end_us=integer(fields, "time_end", -MAX_INT64, MAX_INT64),
        end=boolean(fields, "end"),
        width=integer(fields, "width", 1, MAX_PIXELS),
        height=integer(fields, "height", 1, MAX_PIXELS),
        sensor=name(fields, "sensor"),
        tick_us=integer(fields, "tick_us", 1, MAX_INT64),
        seed=integer(fields, "seed", -MAX_INT64, 2 * MAX_INT64 + 1),
        cameras=_cameras(fields),
        last=_last(fields),
        pace=_pace(fields),
    )


def _pace(fields: dict[str, Any]) -> Pace | None:
    """The pace; None where the status has none."""
    pace = fields.get("pace")
    if pace is None:
        return None
    if not isinstance(pace, dict):
        raise MessageError(f"header field 'pace' is {shown(pace)}, not a map")
    speed = pace.get("speed")
    if isinstance(speed, bool) or not isinstance(speed, int | float) or not 0 < speed < math.inf:
        raise MessageError(f"header field 'pace' has the speed {shown(speed)}, not a number over 0")
    counts = {key: integer(pace, key, 0, MAX_INT64) for key in _PACE_COUNTS}
    return Pace(speed=float(speed), **counts)


def _last(fields: dict[str, Any]) -> dict[str, int]:
    """Last seq of each topic."""
    found = fields.get("last")
    if not isinstance(found, dict) or len(found) > MAX_TOPICS:
        raise MessageError(f"header field 'last' is {shown(found)}, not a map of topics")
    for topic in found:
        if not isinstance(topic, str):
            raise MessageError(f"header field 'last' holds {shown(topic)}, not a topic")
        integer(found, topic, -1, MAX_INT64)
    return found


def _cameras(fields: dict[str, Any]) -> tuple[str, ...]:
    """The list of camera names; it has to hold the status's own camera."""
    names = fields.get("cameras")
    if not isinstance(names, list) or len(names) > MAX_CAMERAS:
        raise MessageError(
            f"header field 'cameras' is {shown(names)}, not a list of up to {MAX_CAMERAS}"
        )
    cameras = tuple(name({"cameras": entry}, "cameras") for entry in names)
    if fields.get("camera") not in cameras:
        raise MessageError("header field 'cameras' does not hold the status's own camera")
    return cameras
