"""The sinks of a run: opened, written to and closed together. One that stops is left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol, TypeVar

from evs.drivers.run.sensor_control import SensorControl
from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.emulator.base.protocols import Meter
from evs.emulator.base.scene import F32, GroundTruth
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


class AuxiliaryStreams(Protocol):
    """A camera as sinks see it: everything of a tick but its events."""

    @property
    def info(self) -> StreamInfo:
        """The constant facts of its stream."""

    @property
    def frames(self) -> Sequence[Frame]:
        """Intensity frames of the last tick."""

    @property
    def imu_packet(self) -> ImuPacket | None:
        """IMU samples of the last tick; None without an IMU."""

    @property
    def pose(self) -> Pose | None:
        """Where it was at the end of the last tick."""

    @property
    def luminance(self) -> F32:
        """(h, w) float32 light of the last tick."""

    def ground_truth(self) -> GroundTruth:
        """Ground truth at the end of the last tick; computed at each call."""


class SinkSet:
    """All sinks of one run. Raises EvsError where one cannot accept what it is given.

    A sink that raises SinkStoppedError (its disk is full) gets nothing more, `warn` is called, and
    the others go on; the error is raised where no other sink is left.
    """

    def __init__(
        self,
        sinks: Sequence[Sink],
        meter: Meter,
        warn: Callable[[str], None],
        sensors: SensorControl | None = None,
    ) -> None:
        """Make a set of sinks that are not open yet.

        Args:
            sinks: In the order in which they are opened and written to.
            meter: Every sink gets it before it is opened.
            warn: Called with one line for each sink that stops.
            sensors: Every sink gets it before it is opened.
        """
        self._meter, self._warn, self._sensors = meter, warn, sensors
        self._all = tuple(sinks)
        self._begun: list[Sink] = []
        self._use(self._all)
        self._trigger_seq: dict[str, int] = {}
        self.reports: list[dict[str, Any]] = []
        """What each sink reported when it was closed."""

    def _use(self, sinks: Sequence[Sink]) -> None:
        """Write to these from now on."""
        self._sinks = tuple(sinks)
        self._takers = {
            stream: tuple(sink for sink in sinks if stream in sink.streams) for stream in Stream
        }

    def open(self, infos: Sequence[StreamInfo]) -> None:
        """Open every sink, in their order."""
        for sink in self._all:
            if type(sink).prepare is not Sink.prepare:
                self._begun.append(sink)
                sink.prepare()
        for sink in self._all:
            # a sink that failed to open may hold something already: it is closed too
            self._begun.append(sink)
            sink.meter, sink.sensors = self._meter, self._sensors
            with disk_errors():
                sink.open(infos)

    def write_tick(
        self,
        cameras: Sequence[AuxiliaryStreams],
        packets: Sequence[EventPacket],
        t_us: int,
        pace: Pace | None = None,
    ) -> None:
        """Hand over everything of a tick, in the order that Sink promises.

        Args:
            cameras: After the tick.
            packets: Their events.
            t_us: Simulated time at the end of the tick, us.
            pace: How the run keeps its pace, where that is due.
        """
        if pace is not None:
            self.write_pace(pace)
        self.write_auxiliary(cameras, t_us)
        self.write(packets)

    def write(self, packets: Sequence[EventPacket]) -> None:
        """Hand event packets to the sinks."""
        for packet in packets:
            for sink in self._takers[Stream.EVENTS]:
                self._give(sink, sink.write, packet)

    def write_auxiliary(self, cameras: Sequence[AuxiliaryStreams], t_us: int) -> None:
        """Hand everything of the last tick but events to the sinks that want it."""
        for camera in cameras:
            for frame in camera.frames:
                self._write_frame(frame, camera.info)
            if camera.imu_packet is not None:
                for sink in self._takers[Stream.IMU]:
                    self._give(sink, sink.write_imu, camera.imu_packet)
            self._write_wanted(camera, t_us)

    def write_recorded(
        self, message: EventPacket | Frame | ImuPacket | TriggerPacket, info: StreamInfo
    ) -> None:
        """Hand a message of a recording to the sinks that want its kind."""
        if isinstance(message, EventPacket):
            self.write([message])
        elif isinstance(message, Frame):
            for sink in self._takers[Stream.FRAMES]:
                self._give(sink, sink.write_frame, message)
        elif isinstance(message, ImuPacket):
            for sink in self._takers[Stream.IMU]:
                self._give(sink, sink.write_imu, message)
        else:
            for sink in self._takers[Stream.TRIGGERS] if info.triggers else ():
                self._give(sink, sink.write_triggers, message)

    def write_pace(self, pace: Pace) -> None:
        """Hand over how the run keeps its pace."""
        for sink in self._takers[Stream.PACE]:
            self._give(sink, sink.write_pace, pace)

    @property
    def stop_wanted(self) -> bool:
        """Whether a client of a sink requested the end of the run."""
        return any(sink.stop_wanted for sink in self._all)

    def _write_wanted(self, camera: AuxiliaryStreams, t_us: int) -> None:
        """What is computed only where a sink wants it now."""
        name = camera.info.camera
        for sink in self._takers[Stream.POSE]:
            if sink.wants_pose(name) and (pose := camera.pose) is not None:
                self._give(sink, sink.write_pose, pose)
        for sink in self._takers[Stream.GROUND_TRUTH]:
            if sink.wants_truth(name, t_us):
                self._give(sink, partial(sink.write_truth, name), camera.ground_truth())
        for sink in self._takers[Stream.LIGHT]:
            if sink.wants_light(name, t_us):
                self._give(sink, partial(sink.write_light, name, t_us), camera.luminance)

    def _write_frame(self, frame: Frame, info: StreamInfo) -> None:
        seq = self._trigger_seq.get(info.camera, 0)
        marks = TriggerPacket(seq, frame_triggers(frame), info.camera)
        self._trigger_seq[info.camera] = seq + 1
        for sink in self._takers[Stream.FRAMES]:
            self._give(sink, sink.write_frame, frame)
        for sink in self._takers[Stream.TRIGGERS] if info.triggers else ():
            self._give(sink, sink.write_triggers, marks)

    def _give(self, sink: Sink, write: Callable[[M], None], message: M) -> None:
        # no `with disk_errors()`, which costs more than handing over a packet
        try:
            write(message)
        except OSError as reason:
            raise _disk_error(reason) from reason
        except SinkStoppedError as error:
            self._use([one for one in self._sinks if one is not sink])
            if not self._sinks:
                raise
            self._warn(str(error))

    def close(self) -> BaseException | None:
        """Close every sink that was opened, the last first; the first error, if any."""
        first: BaseException | None = None
        for sink in (sink for sink in reversed(self._all) if sink in self._begun):
            try:
                with disk_errors():
                    report = sink.close()
                self.reports.insert(0, report)
                if report.get("error") and sink in self._sinks:
                    # it had no error until now, so there was no warning yet
                    self._warn(str(report["error"]))
            except BaseException as error:  # whatever one sink does, the others must be closed
                self.reports.insert(0, {"error": str(error) or type(error).__name__})
                first = first or error
        return first


@contextmanager
def disk_errors() -> Iterator[None]:
    """Turn an operating system's error of a sink into the one line that users see."""
    try:
        yield
    except OSError as reason:
        raise _disk_error(reason) from reason


def _disk_error(reason: OSError) -> EvsError:
    where = f"'{reason.filename}': " if reason.filename else ""
    return EvsError(f"cannot write: {where}{reason.strerror or reason}")
