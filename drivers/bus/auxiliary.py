"""Messages of all topics but events: counted, and held until the next event packet."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from evs.drivers.bus.losses import Gaps
from evs.msgs import (
    CAMERA_INFO,
    CLOCK,
    FRAMES,
    IMU,
    LIGHT,
    POSE,
    TRUTH,
    CameraInfo,
    Clock,
    Frame,
    ImuPacket,
    MessageError,
    Pose,
    Status,
    Topic,
    Truth,
    decode_camera_info,
    decode_clock,
    decode_frame,
    decode_imu,
    decode_pose,
    decode_truth,
)
from evs.msgs.status import MAX_CAMERAS

Counted = Frame | ImuPacket | Pose | Truth
M = TypeVar("M", Frame, ImuPacket, Pose, Truth)
_WITH_RAW: dict[str, Callable[[bytes, bytes], Frame | ImuPacket | Truth]] = {
    FRAMES.name: decode_frame,
    IMU.name: decode_imu,
    LIGHT.name: decode_frame,
    TRUTH.name: decode_truth,
}
"""topic -> decoder of messages of three parts"""

_MOST_COMING = 10_000
"""Messages held between two packets of events; each tick has one of these."""
_MOST_COMING_BYTES = 512 * 1024 * 1024
"""Their raw frames; a publisher that sends no events may not fill our memory."""


class AuxiliaryMessages:
    """Receives the messages of all topics but events and status."""

    def __init__(self) -> None:
        self.gaps: dict[tuple[str, str], Gaps] = {}
        """(topic, camera) -> what was lost"""
        self.clock: Clock | None = None
        self.infos: dict[str, CameraInfo] = {}
        self._coming: list[tuple[str, Counted, int]] = []
        self._bytes = 0

    def take(self, kind: str, camera: str, parts: list[Any]) -> bool:
        """Keep a message; return whether it was of these topics. MessageError as the decoders."""
        if kind in _WITH_RAW and len(parts) == 3:
            self._keep(kind, camera, _WITH_RAW[kind](parts[1], parts[2]), len(parts[2]))
        elif kind == POSE.name and len(parts) == 2:
            self._keep(kind, camera, decode_pose(parts[1]), len(parts[1]))
        elif kind == CAMERA_INFO.name and len(parts) == 2:
            info = decode_camera_info(parts[1])
            self._check(camera, info.camera)
            if camera not in self.infos and len(self.infos) >= MAX_CAMERAS:
                raise MessageError(f"more than {MAX_CAMERAS} cameras on one bus")
            self.infos[camera] = info
        elif kind == CLOCK.name and len(parts) == 2 and not camera:
            self.clock = decode_clock(parts[1])
        else:
            return False
        return True

    def on_status(self, status: Status) -> None:
        """Count losses: a status comes after all messages that were sent before it."""
        for topic, seq in status.last.items():
            gaps = self.gaps.get((topic, status.camera))
            if gaps is not None:
                gaps.on_last(seq)

    def hand_out(self) -> list[tuple[str, Counted]]:
        """Return what came since the last call, each with the name of its topic."""
        handed = [(kind, message) for kind, message, _ in self._coming]
        self._coming.clear()
        self._bytes = 0
        return handed

    def totals(self) -> dict[str, int]:
        """Counts of messages and losses by topic, where any came."""
        found: dict[str, int] = {}
        for (topic, _), gaps in self.gaps.items():
            for key, count in ((topic, gaps.count), (f"{topic}_lost", gaps.lost)):
                found[key] = found.get(key, 0) + count
        return found

    def _keep(self, kind: str, camera: str, message: Counted, size: int) -> None:
        self._check(camera, message.camera)
        if (kind, camera) not in self.gaps and len(self.gaps) >= MAX_CAMERAS * len(_WITH_RAW):
            raise MessageError(f"more than {MAX_CAMERAS} cameras on one bus")
        self.gaps.setdefault((kind, camera), Gaps()).on_message(message.seq)
        self._coming.append((kind, message, size))
        self._bytes += size
        while len(self._coming) > _MOST_COMING or self._bytes > _MOST_COMING_BYTES:
            self._bytes -= self._coming.pop(0)[2]

    @staticmethod
    def _check(topic_camera: str, camera: str) -> None:
        if topic_camera != camera:
            raise MessageError(f"a message of camera {camera!r} under the topic of another")


def of_topic(messages: list[tuple[str, Counted]], topic: Topic, kind: type[M]) -> tuple[M, ...]:
    """Return the messages of one topic, whose messages are of this kind, in their order."""
    return tuple(m for name, m in messages if name == topic.name and isinstance(m, kind))
