"""Record a live stream: what a publisher sends goes into a file, with a list of the gaps in it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from evs.drivers.bus import Connection, Subscription
from evs.drivers.files import to_write
from evs.drivers.files.formats import Format
from evs.drivers.files.paths import target_error
from evs.drivers.run.report import check_targets, report_beside, versions, write_whole
from evs.drivers.run.sink_set import SinkSet
from evs.drivers.sink import Sink
from evs.emulator.base.protocols import NoMeter
from evs.emulator.base.scene import F32, GroundTruth
from evs.msgs import FRAMES, IMU, EventPacket, EvsError, Frame, ImuPacket, Status, StreamInfo

_POLL_S = 0.1
"""Between two checks whether to stop."""

MOST_GAPS = 1000
"""Gaps that are listed; lost packets are counted beyond that, too."""

MOST_BEFORE = 100_000
"""Packets that may come before the first status, which comes ten times a simulated second."""


@dataclass(frozen=True)
class Gap:
    """An interval of the camera's time of which nothing arrived."""

    begin_us: int
    end_us: int
    packets: int

    def __str__(self) -> str:
        span = f"{self.begin_us / 1e6:.6f} s and {self.end_us / 1e6:.6f} s"
        return f"{self.packets:,} between {span}"


class LossLog:
    """Lists the gaps of a subscription to one camera; another object receives from it."""

    def __init__(self, stream: Subscription) -> None:
        self.gaps: list[Gap] = []
        """The first MOST_GAPS."""
        self._stream = stream
        self._lost = 0
        self._end_us = 0
        """time at the end of the last packet"""

    def update(self, packet: EventPacket | None) -> None:
        """Count losses after each receive.

        Args:
            packet: What was received; None: nothing, but perhaps a status came.
        """
        lost, self._lost = self._stream.lost - self._lost, self._stream.lost
        if lost > 0:
            if packet is not None:
                end_us = packet.time_base_us
            else:
                end_us = 0 if self._stream.status is None else self._stream.status.time_end_us
            self._add(Gap(self._end_us, max(self._end_us, end_us), lost))
        if packet is not None:
            self._end_us = packet.time_end_us

    def _add(self, gap: Gap) -> None:
        last = self.gaps[-1] if self.gaps else None
        if last is not None and last.begin_us == gap.begin_us:
            # a status has reported its beginning already
            self.gaps[-1] = Gap(last.begin_us, gap.end_us, last.packets + gap.packets)
        elif len(self.gaps) < MOST_GAPS:
            self.gaps.append(gap)


@dataclass(frozen=True)
class StreamRecording:
    """What a recording holds."""

    file: str
    packets: int = 0
    events: int = 0
    frames: int = 0
    imu_samples: int = 0
    lost: int = 0
    """packets that were sent and did not arrive"""
    gaps: tuple[Gap, ...] = ()
    """where they are missing"""
    ended: str = ""
    """why it ended, in words"""


@dataclass
class _Batch:
    """An event packet and the auxiliary messages that came with it."""

    packet: EventPacket
    frames: tuple[Frame, ...]
    imu: tuple[ImuPacket, ...]


@dataclass(frozen=True)
class _ReceivedCamera:
    """A camera of which only the messages are here."""

    info: StreamInfo
    frames: tuple[Frame, ...]
    imu_packet: ImuPacket | None = None
    pose: None = None

    @property
    def luminance(self) -> F32:
        """Not here, and of no use to a recorder."""
        raise EvsError(f"camera '{self.info.camera}' is elsewhere: its light is not here")

    def ground_truth(self) -> GroundTruth:
        """Not here, and of no use to a recorder."""
        raise EvsError(f"camera '{self.info.camera}' is elsewhere: its ground truth is not here")


class StreamRecorder:
    """Writes a subscription into a file. `run` returns when the stream ends or is stopped.

    The subscription should include frames, IMU and camera_info. The recorder is opened at the first
    status, which has what no packet has; earlier packets are written then. A report beside the file
    lists the gaps where packets were lost.
    """

    def __init__(
        self,
        stream: Subscription,
        file: str,
        sink: Sink | None = None,
        warn: Callable[[str], None] | None = None,
    ) -> None:
        """Choose the recorder by the file's ending; it is opened by `run`.

        Args:
            stream: To record.
            file: The target.
            sink: The recorder, if it has options.
            warn: Gets one line for each warning.

        Raises:
            EvsError: An unknown ending, no place for the file or its report.
        """
        wanted: Format = to_write(file)
        self._stream, self._file, self._holds = stream, file, wanted.capabilities
        warn_of = warn or (lambda _: None)
        if not Path(file).parent.is_dir():
            raise target_error(Path(file), FileNotFoundError())
        check_targets([report_beside(file)])
        self._sinks = SinkSet([sink or wanted.record(Path(file))], NoMeter(), warn_of)
        self._connection = Connection(stream, warn_of)
        self._losses = LossLog(stream)
        self._waiting: list[_Batch] = []
        self._camera = ""
        self._info = StreamInfo(1, 1)
        self._opened = False
        self._counts = {"packets": 0, "events": 0, "frames": 0, "imu_samples": 0}

    def run(
        self, stopped: list[str], duration_s: float | None = None, timeout_s: float | None = None
    ) -> StreamRecording:
        """Record until the publisher ends or `stopped` holds something.

        Args:
            stopped: A list that a signal handler may append to.
            duration_s: Simulated seconds to record at most.
            timeout_s: How long to wait when nothing comes, s.

        Returns:
            What the recording holds.

        Raises:
            EvsError: Nothing came, several cameras, or what the file cannot hold.
        """
        ended, failure = "", None
        try:
            ended = self._record_all(stopped, duration_s, timeout_s)
            if not self._opened:
                # it was stopped before the first status: what has come is kept all the same
                self._open(self._stream.status)
        except BaseException as error:
            failure = error
        closing = self._sinks.close()
        if failure is not None or closing is not None:
            raise failure or closing or EvsError("")
        if not self._opened:
            where = self._stream.address
            raise EvsError(
                f"nothing came from {where}, so '{self._file}' was not made: is a camera running "
                "there? (evs emulate --publish starts one)"
            )
        lost = self._stream.tallies[self._camera].lost
        recording = StreamRecording(
            self._file, **self._counts, lost=lost, gaps=tuple(self._losses.gaps), ended=ended
        )
        report = {**asdict(recording), "address": self._stream.address, "camera": self._camera}
        write_whole(
            json.dumps({**report, "versions": versions()}, indent=2) + "\n",
            report_beside(self._file),
        )
        return recording

    def _record_all(
        self, stopped: list[str], duration_s: float | None, timeout_s: float | None
    ) -> str:
        first_us: int | None = None
        silent_s = 0.0
        while not stopped:
            packet = self._stream.receive(_POLL_S)
            self._connection.update()
            self._losses.update(packet)
            if packet is None:
                if self._stream.ended:
                    return "the camera has ended"
                silent_s += _POLL_S
                if timeout_s is not None and silent_s >= timeout_s:
                    return f"nothing came for {timeout_s:g} s"
                continue
            silent_s = 0.0
            if self._camera and packet.camera != self._camera:
                raise self._several_cameras()
            self._camera = packet.camera
            if self._stream.tallies[packet.camera].restarts:
                return "the camera began a new run"
            self._add(_Batch(packet, self._stream.frames, self._stream.imu))
            first_us = packet.time_base_us if first_us is None else first_us
            if duration_s is not None and packet.time_end_us >= first_us + 1e6 * duration_s:
                return f"{duration_s:g} s are recorded"
        return stopped[0]

    def _add(self, batch: _Batch) -> None:
        if self._opened:
            self._write(batch)
            return
        self._waiting.append(batch)
        if len(self._waiting) > MOST_BEFORE:
            raise EvsError(f"{MOST_BEFORE} packets without a status from {self._stream.address}")
        if self._stream.status is not None:
            self._open(self._stream.status)

    def _open(self, status: Status | None) -> None:
        if status is None and not self._waiting:
            return
        if status is not None and len(status.cameras) > 1 and not self._stream.camera:
            raise self._several_cameras()
        info = self._info_of(self._waiting[0].packet) if status is None else _info(status)
        received = self._stream.camera_info.get(info.camera)
        calibration = {} if received is None else asdict(received)
        calibration.pop("camera", None)
        plain = {k: list(v) if isinstance(v, tuple) else v for k, v in calibration.items()}
        holds = self._holds
        self._info = replace(
            info,
            camera_info=plain,
            frames=info.frames and holds.frames,
            triggers=info.frames and holds.triggers,
            imu=info.imu and holds.imu,
        )
        self._camera = info.camera
        self._sinks.open([self._info])
        self._opened = True
        for batch in self._waiting:
            self._write(batch)
        self._waiting.clear()

    def _info_of(self, packet: EventPacket) -> StreamInfo:
        """The StreamInfo that the packets themselves give."""
        came = self._waiting
        return StreamInfo(
            width=packet.width,
            height=packet.height,
            camera=packet.camera,
            sensor="unknown",
            tick_us=max(1, packet.time_end_us - packet.time_base_us),
            frames=any(batch.frames for batch in came),
            imu=any(batch.imu for batch in came),
        )

    def _write(self, batch: _Batch) -> None:
        t_us = batch.packet.time_end_us
        if self._info.frames and batch.frames:
            self._sinks.write_auxiliary([_ReceivedCamera(self._info, batch.frames)], t_us)
            self._counts["frames"] += len(batch.frames)
        if self._info.imu:
            for samples in batch.imu:
                self._sinks.write_auxiliary([_ReceivedCamera(self._info, (), samples)], t_us)
                self._counts["imu_samples"] += len(samples)
        self._sinks.write([batch.packet])
        self._counts["packets"] += 1
        self._counts["events"] += len(batch.packet)

    def _several_cameras(self) -> EvsError:
        status = self._stream.status
        known = ", ".join(status.cameras if status is not None else self._stream.tallies)
        return EvsError(f"several cameras are on {self._stream.address}: choose one of {known}")


def _info(status: Status) -> StreamInfo:
    """The StreamInfo that a status gives."""
    return StreamInfo(
        width=status.width,
        height=status.height,
        camera=status.camera,
        sensor=status.sensor,
        tick_us=status.tick_us,
        seed=status.seed,
        frames=FRAMES.name in status.last,
        imu=IMU.name in status.last,
    )
