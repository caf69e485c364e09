"""StreamInfo: the constant facts of a stream, for recordings and subscribers."""

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
    """Whether the stream has intensity frames."""
    imu: bool = False
    """Whether the stream has IMU samples."""
    triggers: bool = False
    """Whether the stream has triggers."""
    latency_us: int = 0
    """Delay of the events behind the light that caused them, us; their time stamps include it."""
    classes: list[str] = field(default_factory=list)
    """Names of what class_id counts, if the events are labelled."""

    @property
    def start_us(self) -> int:
        """Start of its time stamps, us: scene.start_us of its configuration; 0 if missing."""
        scene = self.config.get("scene")
        start = scene.get("start_us", 0) if isinstance(scene, dict) else 0
        return start if type(start) is int and 0 <= start < 1 << 53 else 0
