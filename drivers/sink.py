"""The protocol of everything that packets leave through: bus, recorders, ROS 2 and others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from evs.emulator.base.ground_truth import GroundTruth
from evs.emulator.base.protocols import Meter
from evs.emulator.base.scene import F32
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, Pace, Pose, StreamInfo, TriggerPacket


class SinkStoppedError(EvsError):
    """A sink can take nothing more, as on a full disk. What it took is safe.

    A run goes on without it as long as another sink is left, and warns of it once.
    """


class Sink(Protocol):
    """Takes the packets of one or more cameras. Raises EvsError with one line where it cannot."""

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Get ready: bind, create the file, write the header. Called once, before any packet."""

    def write(self, packet: EventPacket) -> None:
        """Take one packet. Never blocks longer than a write to disk takes."""

    def close(self) -> dict[str, Any]:
        """Flush and release; plain values for the run report. Safe to call twice."""


@runtime_checkable
class MeteredSink(Protocol):
    """A sink that tells packing from sending: it laps "pack" on `meter` once a packet is bytes.

    The run loop sets `meter` before `open`; what is not lapped as "pack" counts as "sink".
    """

    meter: Meter


@runtime_checkable
class PreparingSink(Protocol):
    """A sink that takes its time to get ready: all of a run do so at once, before any is opened."""

    def prepare(self) -> None:
        """Begin to get ready, without waiting. `close` is called whatever happens next."""


@runtime_checkable
class FrameSink(Protocol):
    """A sink that also takes the intensity frames of cameras whose StreamInfo says `frames`."""

    def write_frame(self, frame: Frame) -> None:
        """Take one frame, before the packet of the tick in which its read-out ended."""


@runtime_checkable
class ImuSink(Protocol):
    """A sink that also takes the IMU samples of cameras whose StreamInfo says `imu`."""

    def write_imu(self, packet: ImuPacket) -> None:
        """Take the samples of one tick, before its events."""


@runtime_checkable
class TriggerSink(Protocol):
    """A sink that also takes the triggers of cameras whose StreamInfo says `triggers`."""

    def write_triggers(self, packet: TriggerPacket) -> None:
        """Take the triggers of one tick, after its frames and before its events."""


@runtime_checkable
class PoseSink(Protocol):
    """A sink that also takes the poses of cameras, while it has a use for them."""

    def wants_pose(self, camera: str) -> bool:
        """Whether to work out the pose of this tick for it."""

    def write_pose(self, pose: Pose) -> None:
        """Take the pose at the end of a tick, before its events."""


@runtime_checkable
class TruthSink(Protocol):
    """A sink that also takes ground truth while it has a use for it: it costs a frame to trace."""

    def wants_truth(self, camera: str, t_us: int) -> bool:
        """Whether to work it out for the tick that ends at simulated time t_us."""

    def write_truth(self, camera: str, truth: GroundTruth) -> None:
        """Take the ground truth at the end of a tick, before its events."""


@runtime_checkable
class PaceSink(Protocol):
    """A sink that also takes how the run keeps up with the wall clock, where it is held to it."""

    def write_pace(self, pace: Pace) -> None:
        """Take it, ten times a simulated second, before the events of the tick."""


@runtime_checkable
class StoppingSink(Protocol):
    """A sink through which somebody may ask for the end of the run."""

    @property
    def stop_wanted(self) -> bool:
        """Whether somebody did: the run ends after the tick."""


@runtime_checkable
class LightSink(Protocol):
    """A sink that also takes the light on the sensor, while it has a use for it."""

    def wants_light(self, camera: str, t_us: int) -> bool:
        """Whether to hand over that of the tick that ends at simulated time t_us."""

    def write_light(self, camera: str, t_us: int, luminance: F32) -> None:
        """Take it, (h, w) float32 linear luminance, before the events of the tick."""
