"""The state of a publisher for each camera: topics, subscribers, totals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from evs.msgs import (
    CLOCK,
    EVENTS,
    FRAMES,
    IMU,
    TOPICS,
    CameraInfo,
    CameraState,
    EvsError,
    ImuPacket,
    Pace,
    Pose,
    Status,
    StreamInfo,
    Topic,
    camera_info_of,
    encode_camera_info,
    encode_state,
    encode_status,
)
from evs.msgs.header_fields import check_name
from evs.msgs.pictures import SteadyExposure
from evs.msgs.state import State
from evs.msgs.status import MAX_CAMERAS


@dataclass
class Channel:
    """One camera's topics and its totals."""

    stream: StreamInfo
    topics: dict[Topic, bytes]
    """topic -> topic frame"""
    info: CameraInfo | None = None
    listeners: dict[Topic, int] = field(default_factory=lambda: dict.fromkeys(TOPICS, 0))
    last: dict[str, int] = field(default_factory=dict)
    """topic beside the events -> seq of its last message"""
    seq: int = -1
    packets: int = 0
    events: int = 0
    time_end_us: int = 0
    pose: Pose | None = None
    pace: Pace | None = None
    """of the run"""
    imu: ImuPacket | None = None
    light_seq: int = -1
    """seq of the last picture of the light"""
    light_due_s: float = 0.0
    """when the next one is due at the earliest, by the wall clock"""
    exposure: SteadyExposure = field(default_factory=SteadyExposure)
    """of these pictures"""

    def status(self, cameras: tuple[str, ...], *, end: bool) -> Status:
        """Return its totals now."""
        stream = self.stream
        return Status(
            camera=stream.camera,
            seq=self.seq,
            packets=self.packets,
            events=self.events,
            time_end_us=self.time_end_us,
            end=end,
            width=stream.width,
            height=stream.height,
            sensor=stream.sensor,
            tick_us=stream.tick_us,
            seed=stream.seed,
            cameras=cameras,
            last=dict(self.last),
            pace=self.pace,
        )

    def state(self, *, end: bool) -> CameraState:
        """Return its newest state."""
        sample = None if self.imu is None or not len(self.imu) else self.imu.samples[-1]
        return CameraState(
            camera=self.stream.camera,
            seq=self.seq,
            packets=self.packets,
            events=self.events,
            end=end,
            position=() if self.pose is None else self.pose.position,
            orientation=() if self.pose is None else self.pose.orientation,
            acceleration=() if sample is None else tuple(sample["acceleration"].tolist()),
            angular_velocity=() if sample is None else tuple(sample["angular_velocity"].tolist()),
        )


class Audience:
    """Counts the subscribers of each topic, from their requests."""

    def __init__(self, channels: dict[str, Channel]) -> None:
        self.channels = channels
        self.subscribers = 0
        """Of events."""
        self.clock = 0
        """Of the clock."""

    def take(self, request: bytes) -> None:
        """Read a request: one byte, 1 or 0, and a prefix of topics; others are ignored."""
        if request[:1] not in (b"\x00", b"\x01"):
            return
        change = 1 if request[0] else -1
        prefix, wants_events = request[1:], False
        for channel in self.channels.values():
            for topic, name in channel.topics.items():
                if name.startswith(prefix):
                    channel.listeners[topic] = max(0, channel.listeners[topic] + change)
                    wants_events |= topic == EVENTS
        if CLOCK.of("").startswith(prefix):
            self.clock = max(0, self.clock + change)
        if wants_events:
            self.subscribers = max(0, self.subscribers + change)

    @property
    def anybody(self) -> bool:
        """Whether any topic of a camera has a subscriber."""
        return any(any(one.listeners.values()) for one in self.channels.values())

    @property
    def cameras(self) -> tuple[str, ...]:
        """Every camera on this bus."""
        return tuple(self.channels)

    def statuses(self, *, end: bool) -> list[Status]:
        """Return the status of every camera."""
        return [one.status(self.cameras, end=end) for one in self.channels.values()]

    def state(self, *, end: bool) -> State:
        """Return the newest state of all cameras."""
        channels = self.channels.values()
        return State(
            max(one.time_end_us for one in channels), tuple(one.state(end=end) for one in channels)
        )


def make_channels(streams: Sequence[StreamInfo]) -> dict[str, Channel]:
    """Return a channel for each stream, by name. EvsError for values that no message can hold."""
    if not 1 <= len(streams) <= MAX_CAMERAS:
        raise EvsError(f"{len(streams)} cameras on one bus: give 1 ... {MAX_CAMERAS}")
    channels: dict[str, Channel] = {}
    for stream in streams:
        check_name(stream.camera, "camera name")
        if stream.camera in channels:
            raise EvsError(f"two cameras are named '{stream.camera}': give each its own name")
        topics = {topic: topic.of(stream.camera) for topic in TOPICS if topic.per_camera}
        channel = Channel(stream, topics, camera_info_of(stream))
        # so that a status lists from the start what the camera has
        channel.last |= {FRAMES.name: -1} if stream.frames else {}
        channel.last |= {IMU.name: -1} if stream.imu else {}
        channels[stream.camera] = channel
    # values that do not fit into a message are an error now, not in the middle of the run
    audience = Audience(channels)
    for channel in channels.values():
        encode_status(channel.status(tuple(channels), end=False))
        if channel.info is not None:
            encode_camera_info(channel.info)
    encode_state(audience.state(end=False))
    return channels
