"""What travels through the ring: a head of 64 bytes and the arrays as they lie in memory.

Both ends are one version of one program on one machine: nothing is checked, packed or converted.
That is why the ring does not use the bus's encoders (evs.msgs), which check each message and pack a
map of names for receivers of any version. They take longer than all that the camera pays here, and
have no message for labels, triggers, light and pace. Best of many, us a message without the copy:

    ====================  ====  ========
    message               ring  evs.msgs
    ====================  ====  ========
    1000 events            1.1       3.9
    IMU samples, a tick    1.5       8.0
    frame of 346 x 260     1.7       5.7
    pose                   0.7      13.5
    ====================  ====  ========
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from evs.drivers.run.worker.shared_memory import Bytes
from evs.emulator.base.scene import F32, GroundTruth
from evs.msgs import (
    EVENT_DTYPE,
    IMU_DTYPE,
    TRIGGER_DTYPE,
    EventPacket,
    Frame,
    ImuPacket,
    Pace,
    Pose,
    TriggerPacket,
)
from evs.msgs.event import LABEL_DTYPE, clean_events
from evs.msgs.ground_truth import TRUTH_CHANNELS

HEAD = struct.Struct("<BBHIqqqqqIIII")
"""kind, whether labels come, camera's place, elements, five integers, height, width, item size."""

_POSE = struct.Struct("<7d")
_SPEED = struct.Struct("<d")


class Kind(IntEnum):
    """What a message is."""

    EVENTS = 0
    FRAME = 1
    IMU = 2
    TRIGGERS = 3
    POSE = 4
    TRUTH = 5
    LIGHT = 6
    PACE = 7


_EVENTS = int(Kind.EVENTS)


@dataclass(frozen=True)
class Light:
    """The light on the sensor of one camera."""

    camera: str
    t_us: int
    luminance: F32


@dataclass(frozen=True)
class TruthOf:
    """Ground truth and the camera that it is of."""

    camera: str
    truth: GroundTruth


Message = EventPacket | Frame | ImuPacket | TriggerPacket | Pose | TruthOf | Light | Pace
Read = Callable[[int], np.ndarray[Any, np.dtype[np.uint8]]]
"""The next n bytes, (n,) uint8, in memory of their own."""


def of_events(packet: EventPacket, place: int) -> list[Bytes]:
    """Head, events, labels. Padding goes as it is: whoever hands out raw bytes cleans it."""
    events = packet.events
    if events.dtype != EVENT_DTYPE or not events.flags.c_contiguous:
        events = clean_events(events)
    labels = packet.labels
    span = packet.seq, packet.time_base_us, packet.time_end_us
    head = HEAD.pack(
        *(_EVENTS, labels is not None, place, len(events)),
        *(*span, 0, 0, packet.height, packet.width, 0, 0),
    )
    raw = events.view(np.uint8).data
    return [head, raw] if labels is None else [head, raw, _raw(labels, LABEL_DTYPE)]


def of_frame(frame: Frame, place: int) -> list[Bytes]:
    """Head, pixels."""
    pixels = np.asarray(frame.pixels)
    stamps = frame.begin_us, frame.exposure_begin_us, frame.exposure_end_us, frame.end_us
    size, item = (frame.height, frame.width), pixels.dtype.itemsize
    return [_head(Kind.FRAME, place, 0, (frame.seq, *stamps), size, item), _raw(pixels)]


def of_imu(packet: ImuPacket, place: int) -> list[Bytes]:
    """Head, samples."""
    head = _head(Kind.IMU, place, len(packet), (packet.seq,))
    return [head, _raw(packet.samples, IMU_DTYPE)]


def of_triggers(packet: TriggerPacket, place: int) -> list[Bytes]:
    """Head, triggers."""
    head = _head(Kind.TRIGGERS, place, len(packet), (packet.seq,))
    return [head, _raw(packet.triggers, TRIGGER_DTYPE)]


def of_pose(pose: Pose, place: int) -> list[Bytes]:
    """Head, seven doubles."""
    head = _head(Kind.POSE, place, 0, (pose.seq, pose.t_us))
    return [head, _POSE.pack(*pose.position, *pose.orientation)]


def of_truth(truth: GroundTruth, place: int) -> list[Bytes]:
    """Head, the planes of every channel in the order of TRUTH_CHANNELS."""
    height, width = truth.depth.shape
    planes = [_raw(getattr(truth, key), kind) for key, (kind, _) in TRUTH_CHANNELS.items()]
    return [_head(Kind.TRUTH, place, 0, (truth.t_us,), (height, width)), *planes]


def of_light(t_us: int, luminance: F32, place: int) -> list[Bytes]:
    """Head, the picture."""
    height, width = luminance.shape
    head = _head(Kind.LIGHT, place, 0, (t_us,), (height, width))
    return [head, _raw(luminance, np.dtype("<f4"))]


def of_pace(pace: Pace) -> list[Bytes]:
    """Head, one double. Of no camera."""
    counts = pace.late_us, pace.worst_late_us, pace.slipped_us, pace.slips
    return [_head(Kind.PACE, 0, 0, counts), _SPEED.pack(pace.speed)]


def receive(read: Read, cameras: tuple[str, ...]) -> Message:
    """The next message, in memory of its own. What `read` raises goes through."""
    kind, labelled, place, count, a, b, c, d, e, height, width, item, _ = HEAD.unpack(
        read(HEAD.size).data
    )
    camera, pixels = cameras[place], height * width
    match Kind(kind):
        case Kind.EVENTS:
            events = read(EVENT_DTYPE.itemsize * count).view(EVENT_DTYPE)
            labels = read(LABEL_DTYPE.itemsize * count).view(LABEL_DTYPE) if labelled else None
            return EventPacket(a, b, c, width, height, events, camera, labels)
        case Kind.FRAME:
            dtype: np.dtype[Any] = np.dtype(f"<u{item}")
            picture = read(pixels * item).view(dtype).reshape(height, width)
            return Frame(a, b, c, d, e, picture, camera)
        case Kind.IMU:
            return ImuPacket(a, read(IMU_DTYPE.itemsize * count).view(IMU_DTYPE), camera)
        case Kind.TRIGGERS:
            marks = read(TRIGGER_DTYPE.itemsize * count).view(TRIGGER_DTYPE)
            return TriggerPacket(a, marks, camera)
        case Kind.POSE:
            x, y, z, i, j, k, w = _POSE.unpack(read(_POSE.size).data)
            return Pose(a, b, (x, y, z), (i, j, k, w), camera)
        case Kind.TRUTH:
            planes = {}
            for key, (kind_of, numbers) in TRUTH_CHANNELS.items():
                shape = (height, width, numbers)[: 2 + (numbers > 1)]
                raw = read(pixels * numbers * kind_of.itemsize)
                planes[key] = raw.view(kind_of).reshape(shape)
            return TruthOf(camera, GroundTruth(a, **planes))
        case Kind.PACE:
            (speed,) = _SPEED.unpack(read(_SPEED.size).data)
            return Pace(speed, a, b, c, d)
        case Kind.LIGHT:
            return Light(camera, a, read(4 * pixels).view(np.dtype("<f4")).reshape(height, width))


def _head(
    kind: Kind,
    place: int,
    count: int,
    integers: tuple[int, ...],
    size: tuple[int, int] = (0, 0),
    item: int = 0,
) -> bytes:
    five = (*integers, 0, 0, 0, 0, 0)[:5]
    return HEAD.pack(kind, False, place, count, *five, *size, item, 0)


def _raw(array: np.ndarray[Any, Any], dtype: np.dtype[Any] | None = None) -> memoryview:
    packed = np.ascontiguousarray(array, dtype)
    return packed.reshape(-1).view(np.uint8).data
