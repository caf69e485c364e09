"""The sinks of a run: opened, written to and closed together. One that stops is left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol, TypeVar

from evs.drivers.sink import (
    FrameSink,
    ImuSink,
    LightSink,
    MeteredSink,
    PaceSink,
    PoseSink,
    PreparingSink,
    Sink,
    SinkStoppedError,
    StoppingSink,
    TriggerSink,
    TruthSink,
)
from evs.emulator.base.ground_truth import GroundTruth
from evs.emulator.base.protocols import Meter
from evs.emulator.base.scene import F32
from evs.msgs import (
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    Pace,
    Pose,
    StreamInfo,
    TriggerPacket,
    frame_triggers,
)

M = TypeVar("M")


class Beside(Protocol):
    """What the outlets want to know of a camera."""

    @property
    def info(self) -> StreamInfo:
        """What is constant of its stream."""

    @property
    def frames(self) -> Sequence[Frame]:
        """Intensity frames of the last tick."""

    @property
    def imu_packet(self) -> ImuPacket | None:
        """What its IMU said in the last tick."""

    @property
    def pose(self) -> Pose | None:
        """Where it was at the end of the last tick."""

    @property
    def luminance(self) -> F32:
        """(h, w) float32 light of the last tick."""

    def ground_truth(self) -> GroundTruth:
        """What it really showed then; computed at each call."""


class Outlets:
    """All sinks of one run. Raises EvsError where one cannot take what it is given.

    A sink that says SinkStoppedError (its disk is full) gets nothing more, `warn` hears of it, and
    the others go on; the error is raised where no other is left.
    """

    def __init__(self, sinks: Sequence[Sink], meter: Meter, warn: Callable[[str], None]) -> None:
        """In: meter is given to the sinks that lap it, before they open."""
        self._sinks, self._meter, self._warn = list(sinks), meter, warn
        self._all = tuple(sinks)
        self._begun: list[Sink] = []
        # asked of each sink once: it takes longer than handing over a packet
        self._frame_sinks = [sink for sink in sinks if isinstance(sink, FrameSink)]
        self._imu_sinks = [sink for sink in sinks if isinstance(sink, ImuSink)]
        self._trigger_sinks = [sink for sink in sinks if isinstance(sink, TriggerSink)]
        self._pace_sinks = [sink for sink in sinks if isinstance(sink, PaceSink)]
        self._pose_sinks = [sink for sink in sinks if isinstance(sink, PoseSink)]
        self._truth_sinks = [sink for sink in sinks if isinstance(sink, TruthSink)]
        self._light_sinks = [sink for sink in sinks if isinstance(sink, LightSink)]
        self._stopping_sinks = [sink for sink in sinks if isinstance(sink, StoppingSink)]
        self._trigger_seq: dict[str, int] = {}
        self.said: list[dict[str, Any]] = []
        """What each sink said when it was closed."""

    def open(self, infos: Sequence[StreamInfo]) -> None:
        """Open every sink, in their order."""
        for sink in self._all:
            if isinstance(sink, PreparingSink):
                self._begun.append(sink)
                sink.prepare()
        for sink in self._all:
            # a sink that failed to open may hold something already: it is closed too
            self._begun.append(sink)
            if isinstance(sink, MeteredSink):
                sink.meter = self._meter
            with disk_errors():
                sink.open(infos)

    def write(self, packets: Sequence[EventPacket]) -> None:
        """Hand packets to every sink."""
        for packet in packets:
            # one that stops is taken out of a new list
            for sink in self._sinks:
                self._give(sink, sink.write, packet)

    def write_beside(self, cameras: Sequence[Beside], t_us: int) -> None:
        """Frames, triggers and IMU samples of the last tick, to the sinks that take them."""
        for camera in cameras:
            for frame in camera.frames:
                self._write_frame(frame, camera.info)
            if camera.imu_packet is not None:
                for sink in self._imu_sinks:
                    self._give(sink, sink.write_imu, camera.imu_packet)
            self._write_wanted(camera, t_us)

    def write_pace(self, pace: Pace) -> None:
        """How the run keeps its pace, to the sinks that tell it."""
        for sink in self._pace_sinks:
            self._give(sink, sink.write_pace, pace)

    @property
    def stop_wanted(self) -> bool:
        """Whether somebody asked a sink for the end of the run."""
        return any(sink.stop_wanted for sink in self._stopping_sinks)

    def _write_wanted(self, camera: Beside, t_us: int) -> None:
        """What is worked out only where a sink has a use for it now."""
        name = camera.info.camera
        for pose_sink in self._pose_sinks:
            if pose_sink.wants_pose(name) and (pose := camera.pose) is not None:
                self._give(pose_sink, pose_sink.write_pose, pose)
        for truth_sink in self._truth_sinks:
            if truth_sink.wants_truth(name, t_us):
                take = partial(truth_sink.write_truth, name)
                self._give(truth_sink, take, camera.ground_truth())
        for light_sink in self._light_sinks:
            if light_sink.wants_light(name, t_us):
                self._give(
                    light_sink, partial(light_sink.write_light, name, t_us), camera.luminance
                )

    def _write_frame(self, frame: Frame, info: StreamInfo) -> None:
        seq = self._trigger_seq.get(info.camera, 0)
        marks = TriggerPacket(seq, frame_triggers(frame), info.camera)
        self._trigger_seq[info.camera] = seq + 1
        for frame_sink in self._frame_sinks:
            self._give(frame_sink, frame_sink.write_frame, frame)
        for trigger_sink in self._trigger_sinks if info.triggers else ():
            self._give(trigger_sink, trigger_sink.write_triggers, marks)

    def _give(self, sink: object, take: Callable[[M], None], message: M) -> None:
        if sink not in self._sinks:
            return
        # no `with disk_errors()`, which costs more than handing over a packet
        try:
            take(message)
        except OSError as reason:
            raise _disk_error(reason) from reason
        except SinkStoppedError as error:
            self._sinks = [one for one in self._sinks if one is not sink]
            if not self._sinks:
                raise
            self._warn(str(error))

    def close(self) -> BaseException | None:
        """Close every sink that was opened, the last first; the first error, if any."""
        first: BaseException | None = None
        for sink in (sink for sink in reversed(self._all) if sink in self._begun):
            try:
                with disk_errors():
                    said = sink.close()
                self.said.insert(0, said)
                if said.get("error") and sink in self._sinks:
                    # it was well until now: nobody has been told yet
                    self._warn(str(said["error"]))
            except BaseException as error:  # whatever one sink does, the others must be closed
                self.said.insert(0, {"error": str(error) or type(error).__name__})
                first = first or error
        return first


@contextmanager
def disk_errors() -> Iterator[None]:
    """An operating system's error of a sink, as the one line that users see."""
    try:
        yield
    except OSError as reason:
        raise _disk_error(reason) from reason


def _disk_error(reason: OSError) -> EvsError:
    where = f"'{reason.filename}': " if reason.filename else ""
    return EvsError(f"cannot write: {where}{reason.strerror or reason}")
