"""One table says everything about a topic."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """What travels under a name, how often, and what happens when a subscriber is slow."""

    name: str
    message: str
    """The type of what follows the topic frame."""
    rate: str
    queue: int
    """Messages queued per subscriber before the drop policy applies."""
    drop: str
    """Which messages a slow subscriber loses."""

    def of(self, camera: str) -> bytes:
        """The topic frame of one camera: `name/camera` in UTF-8, e.g. b"events/track"."""
        return f"{self.name}/{camera}".encode()


DEFAULT_ADDRESS = "tcp://127.0.0.1:5560"
"""Where a camera publishes and a subscriber looks, if nothing else is said."""

EVENTS = Topic(
    "events", "EventPacket", "one a tick and camera", 1000, "newest, counted by seq and status"
)
FRAMES = Topic("frames", "Frame", "as sensor.aps says", 1000, "newest, counted by seq")
IMU = Topic("imu", "ImuPacket", "as sensor.imu says, one a tick at most", 1000, "newest, by seq")
STATUS = Topic("status", "Status", "10 Hz of simulated time, and at the end", 1000, "newest")

TOPICS = (EVENTS, FRAMES, IMU, STATUS)
"""Every topic of the bus."""
