"""The table of topics of the bus: message type, rate, queue and drop policy of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic: its message, its rate, and its behaviour with a slow subscriber.

    Each name has one Topic, so topics are compared by identity.
    """

    name: str
    message: str
    """Type of the message that follows the topic frame."""
    rate: str
    queue: int
    """Messages queued per subscriber before the drop policy applies."""
    drop: str
    """Which messages a slow subscriber loses."""
    per_camera: bool = True
    """False: the bus has one, not each camera."""

    def of(self, camera: str) -> bytes:
        """The topic frame of one camera: `name/camera` in UTF-8, e.g. b"events/track".

        A topic of the whole bus ends at its slash, e.g. b"clock/".
        """
        return f"{self.name}/{camera if self.per_camera else ''}".encode()


DEFAULT_ADDRESS = "tcp://127.0.0.1:5560"
"""Default address of publishers and subscribers."""

_COUNTED = "newest, counted by seq and status"

EVENTS = Topic("events", "EventPacket", "one a tick and camera", 1000, _COUNTED)
FRAMES = Topic("frames", "Frame", "as sensor.aps says", 1000, _COUNTED)
IMU = Topic("imu", "ImuPacket", "as sensor.imu says, one a tick at most", 1000, _COUNTED)
POSE = Topic("pose", "Pose", "one a tick", 1000, _COUNTED)
LIGHT = Topic("light", "Frame", "25 Hz of the wall clock at most", 1000, "newest")
TRUTH = Topic("ground_truth", "Truth", "as truth_hz says", 1000, _COUNTED)
CAMERA_INFO = Topic("camera_info", "CameraInfo", "with each status", 1000, "newest; it repeats")
CLOCK = Topic("clock", "Clock", "one a tick", 1000, "newest; it repeats", per_camera=False)
STATUS = Topic("status", "Status", "10 Hz of simulated time, and at the end", 1000, "newest")

TOPICS = (EVENTS, FRAMES, IMU, POSE, LIGHT, TRUTH, CAMERA_INFO, CLOCK, STATUS)
"""Every topic of the bus."""

STATE_PREFIX = b"state/"
"""What the one-part messages of the port for the latest state begin with."""
