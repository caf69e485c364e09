"""The base class of everything that packets leave through: bus, recorders, ROS 2 and others."""

# ruff: noqa: B027 - a method that does nothing stands for a stream that is not wanted

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from evs.emulator.base.protocols import Meter, NoMeter
from evs.emulator.base.scene import F32, GroundTruth
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, Pace, Pose, StreamInfo, TriggerPacket

if TYPE_CHECKING:
    from evs.drivers.run.sensor_control import SensorControl


class SinkStoppedError(EvsError):
    """A sink cannot accept more, for example on a full disk. Earlier data is safe.

    The run warns once and continues without the sink as long as another sink is left.
    """


class Stream(StrEnum):
    """A kind of message for sinks; each has a `write...` method of Sink."""

    EVENTS = "events"
    FRAMES = "frames"
    IMU = "imu"
    TRIGGERS = "triggers"
    POSE = "pose"
    GROUND_TRUTH = "ground_truth"
    LIGHT = "light"
    PACE = "pace"


class Sink(ABC):
    """Receives the packets of one or more cameras.

    A sink declares its streams in `streams` and overrides their methods; other streams are not
    computed for it. Methods raise EvsError with one line.

    drivers/sink_config.py lists the sinks of pipelines, and drivers/files/formats.py the recorders.

    In a tick, pace comes first, then for each camera its frames with their triggers, IMU samples,
    pose, ground truth and light, and the events of all cameras last.
    """

    streams: frozenset[Stream] = frozenset({Stream.EVENTS})
    """What the sink wants; read once, before `open`."""

    meter: Meter = NoMeter()
    """Set by the run before `open`. A sink laps "pack" once a packet is bytes, to tell packing from
    writing; the rest of its time counts as "sink"."""

    sensors: SensorControl | None = None
    """Set by the run before `open`: the parameters of its sensors that a client of this sink may
    change. None: it takes no changes, as where the sink has a process of its own."""

    @property
    def stop_wanted(self) -> bool:
        """Whether a client of this sink requested the end of the run, after the present tick."""
        return False

    def prepare(self) -> None:
        """Start slow preparations without waiting for them.

        All sinks of a run prepare before any is opened. `close` of a sink that overrides this is
        called whatever happens next.
        """

    @abstractmethod
    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Bind, create the file, write the header: once, before any packet.

        Args:
            streams: What is constant of each camera.
        """

    @abstractmethod
    def write(self, packet: EventPacket) -> None:
        """Write the events of one camera and tick, blocking at most for a write to disk."""

    def write_frame(self, frame: Frame) -> None:
        """Write an intensity frame, before the events of the tick in which its read-out ended.

        Only called for cameras with `frames` in their StreamInfo.
        """

    def write_imu(self, packet: ImuPacket) -> None:
        """Write the IMU samples of one tick, for cameras with `imu` in their StreamInfo."""

    def write_triggers(self, packet: TriggerPacket) -> None:
        """Write the triggers of one frame, for cameras with `triggers` in their StreamInfo."""

    def wants_pose(self, camera: str) -> bool:  # noqa: ARG002
        """Return whether the pose of this camera is to be computed at this tick."""
        return True

    def write_pose(self, pose: Pose) -> None:
        """Write the pose at the end of a tick."""

    def wants_truth(self, camera: str, t_us: int) -> bool:  # noqa: ARG002
        """Return whether ground truth is to be computed at a tick, which costs a frame to trace.

        Args:
            camera: Name of the camera.
            t_us: Simulated time at the end of the tick, us.
        """
        return True

    def write_truth(self, camera: str, truth: GroundTruth) -> None:
        """Write the ground truth at the end of a tick."""

    def wants_light(self, camera: str, t_us: int) -> bool:  # noqa: ARG002
        """Return whether the light on the sensor is needed at a tick; see `wants_truth`."""
        return True

    def write_light(self, camera: str, t_us: int, luminance: F32) -> None:
        """Write the light on the sensor at the end of a tick.

        Args:
            camera: Name of the camera.
            t_us: Simulated time, us.
            luminance: (h, w) float32, linear.
        """

    def write_pace(self, pace: Pace) -> None:
        """Write the pace of the run, ten times per simulated second."""

    @abstractmethod
    def close(self) -> dict[str, Any]:
        """Flush and release. Safe to call twice.

        Returns:
            Plain values for the run report.
        """
