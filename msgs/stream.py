"""StreamInfo: what a recording or a subscriber has to know about a stream besides its events."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class StreamInfo:
    """Constant facts of one camera's stream, known before its first packet."""

    width: int
    """Sensor width, px."""
    height: int
    """Sensor height, px."""
    camera: str = "camera"
    """Name of the camera."""
    sensor: str = "ideal"
    """Name of the sensor preset."""
    tick_us: int = 1000
    """Length of a tick, us."""
    seed: int = 0
    versions: dict[str, str] = field(default_factory=dict)
    """Version of evs and of the packages that shaped the events."""
    config: dict[str, Any] = field(default_factory=dict)
    """The whole configuration of the run, plain values."""
    camera_info: dict[str, Any] = field(default_factory=dict)
    """As in ROS's CameraInfo: width, height, distortion_model, d, k (9), r (9), p (12)."""
    frames: bool = False
    """Whether intensity frames come beside the events."""
    imu: bool = False
    """Whether IMU samples come beside the events."""
    triggers: bool = False
    """Whether triggers come beside the events."""
    latency_us: int = 0
    """By how much events come later than their light, us; their stamps carry it."""

    @property
    def start_us(self) -> int:
        """What its stamps begin at, us: scene.start_us of its configuration; 0: not told."""
        scene = self.config.get("scene")
        start = scene.get("start_us", 0) if isinstance(scene, dict) else 0
        return start if type(start) is int and 0 <= start < 1 << 53 else 0
