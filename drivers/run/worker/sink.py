"""WorkerSink: a sink that runs in a process of its own; this one only copies its packets."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.run.worker import messages, shared_memory
from evs.drivers.run.worker.process import WorkerProcess
from evs.drivers.run.worker.shared_memory import Bytes, RingWriter, SharedMemory, fence
from evs.drivers.sink import Sink, SinkStoppedError
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
    unknown,
)

RING_MB = 64.0
"""Of packets that wait for the other process: 4 million events."""

_MOST_MB = 1e5
_NAP_S = 0.0005
"""Between two checks of a full ring; the worker frees some MB in that time."""
_POLL_EVERY = 256
"""Messages between two checks that the worker still lives, if it sends nothing itself."""


class WorkerSink(Sink):
    """A Sink whose work is done by another process, the worker, on its own copy of every packet.

    What is written is copied into a ring of memory that both processes share. When the ring is
    full, a lossless sink (a recorder) blocks, so no data is lost; any other drops the packet and
    counts it, so the camera is never slowed. The worker ends with this process, however this one
    ends, after it has written all that was copied. Its own death is reported as a sink that stopped
    (SinkStoppedError).
    """

    def __init__(
        self,
        template: Sink,
        config: Mapping[str, Any],
        *,
        lossless: bool,
        ring_mb: float | None = None,
        cores: Sequence[int] | None = None,
    ) -> None:
        """Describe the sink; `prepare` or `open` starts its process.

        Args:
            template: A sink of the same type and options, which is never opened.
            config: Plain values of a SinkConfig, from which the worker makes its own sink.
            lossless: Whether to block when the ring is full.
            ring_mb: Size of the ring, MB; RING_MB if None.
            cores: Processor cores for the worker; those of this process if None.
        """
        ring_mb = RING_MB if ring_mb is None else ring_mb
        if not (math.isfinite(ring_mb) and 0.001 <= ring_mb <= _MOST_MB):
            raise EvsError(f"worker_mb is {ring_mb:g}: give the MB of the ring, as in {RING_MB:g}")
        self._config, self._lossless = dict(config), lossless
        self._ring_bytes = 64 * math.ceil(ring_mb * 1e6 / 64)
        self._cores = None if cores is None else list(cores)
        self.streams = template.streams
        self._places: dict[str, int] = {}
        self._memory: SharedMemory | None = None
        self._process: WorkerProcess | None = None
        self._ring: RingWriter
        self._polled = 0
        self._unpolled = 0
        self._error: EvsError | None = None
        self._torn = ""
        self._closed_report: dict[str, Any] = {"type": config["type"]}
        self._waits, self._waited_s = 0, 0.0
        self._dropped = {"worker_packets_dropped": 0, "worker_others_dropped": 0}
        self._events_dropped = 0

    @property
    def process(self) -> int:
        """Process number of the worker; 0: there is none."""
        return 0 if self._process is None else self._process.number

    @property
    def stop_wanted(self) -> bool:
        """Whether a client of the sink requested the end of the run."""
        if self._process is None:
            return False
        assert self._memory is not None
        return bool(self._memory.slots[shared_memory.STOP])

    def prepare(self) -> None:
        """Start the worker, which loads its libraries while this process goes on."""
        if self._process is None:
            self._memory = SharedMemory.make(self._ring_bytes)
            self._ring = RingWriter(self._memory)
            try:
                self._process = WorkerProcess(self._memory, self._name)
            except BaseException:
                self._memory.close()
                raise
            self._error, self._torn, self._polled = None, "", 0

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Have the sink opened by the worker. Raises EvsError with the line of its error."""
        if len(streams) > shared_memory.MAX_CAMERAS:
            raise EvsError(
                f"{len(streams)} cameras: a worker sink takes {shared_memory.MAX_CAMERAS}"
            )
        self.prepare()
        assert self._process is not None
        self._places = {stream.camera: place for place, stream in enumerate(streams)}
        self._process.open(
            sink=self._config,
            cores=self._cores,
            streams=[dataclasses.asdict(stream) for stream in streams],
        )

    def write(self, packet: EventPacket) -> None:
        """Copy one packet. SinkStoppedError: the sink accepts no more, or the worker died."""
        parts = messages.of_events(packet, self._place(packet.camera))
        if not self._put(parts):
            self._dropped["worker_packets_dropped"] += 1
            self._events_dropped += len(packet)

    def write_frame(self, frame: Frame) -> None:
        """Copy one intensity frame. Errors as write."""
        self._put_other(messages.of_frame(frame, self._place(frame.camera)))

    def write_imu(self, packet: ImuPacket) -> None:
        """Copy one tick's IMU samples. Errors as write."""
        self._put_other(messages.of_imu(packet, self._place(packet.camera)))

    def write_triggers(self, packet: TriggerPacket) -> None:
        """Copy one tick's triggers. Errors as write."""
        self._put_other(messages.of_triggers(packet, self._place(packet.camera)))

    def wants_pose(self, camera: str) -> bool:
        """Return whether the sink wanted it when the worker last checked."""
        return self._flag(shared_memory.POSE, camera)

    def write_pose(self, pose: Pose) -> None:
        """Copy one pose. Errors as write."""
        self._put_other(messages.of_pose(pose, self._place(pose.camera)))

    def write_pace(self, pace: Pace) -> None:
        """Copy how the run keeps its pace. Errors as write."""
        self._check_open()
        self._put_other(messages.of_pace(pace))

    def wants_truth(self, camera: str, t_us: int) -> bool:  # noqa: ARG002
        """Return whether it was due at the first tick, or at a packet that the sink has got."""
        return self._flag(shared_memory.TRUTH, camera)

    def write_truth(self, camera: str, truth: GroundTruth) -> None:
        """Copy ground truth. Errors as write."""
        self._clear(shared_memory.TRUTH, camera)
        self._put_other(messages.of_truth(truth, self._place(camera)))

    def wants_light(self, camera: str, t_us: int) -> bool:  # noqa: ARG002
        """Return whether it was due at a packet that the sink got, as `wants_truth`."""
        return self._flag(shared_memory.LIGHT, camera)

    def write_light(self, camera: str, t_us: int, luminance: F32) -> None:
        """Copy the light on the sensor. Errors as write."""
        self._clear(shared_memory.LIGHT, camera)
        self._put_other(messages.of_light(t_us, luminance, self._place(camera)))

    def close(self) -> dict[str, Any]:
        """Wait until the worker has written everything and closed the sink. Safe to call twice.

        Returns:
            The sink's own report, with our counts.

        Raises:
            EvsError: Closing the sink failed.
        """
        if self._process is not None:
            try:
                message = self._process.close()
            finally:
                self._process = None
                if self._memory is not None:
                    self._memory.close()
            self._closed_report = self._report(message)
            if "failed" in message and self._error is None:
                raise EvsError(message["failed"])
        return dict(self._closed_report)

    @property
    def _name(self) -> str:
        given = (self._config.get(key) for key in ("file", "rrd", "mcap", "address"))
        place = next((one for one in given if one), "")
        return f"{self._config['type']} sink" + (f" '{place}'" if place else "")

    def _report(self, message: Mapping[str, Any]) -> dict[str, Any]:
        found = dict(message.get("report", {"type": self._config["type"]}))
        if not found.get("error") and (
            error := message.get("failed")
            or message.get("stopped")
            or message.get("died")
            or self._torn
        ):
            found["error"] = error
        if self._lossless:
            return {
                **found,
                "worker_waits": self._waits,
                "worker_waited_s": round(self._waited_s, 3),
            }
        # the sink's own drops are further ones
        own = found.get("events_dropped", 0)
        return {**found, **self._dropped, "events_dropped": own + self._events_dropped}

    def _check_open(self) -> None:
        if self._process is None:
            raise EvsError("this sink is not open: call open(streams) first")

    def _place(self, camera: str) -> int:
        self._check_open()
        place = self._places.get(camera)
        if place is None:
            raise unknown("camera of this sink", camera, self._places)
        return place

    def _flag(self, kind: int, camera: str) -> bool:
        if self._memory is None or self._error is not None or self._process is None:
            return False
        return self._memory.flags[kind + self._place(camera)] != 0

    def _clear(self, kind: int, camera: str) -> None:
        if self._memory is not None:
            self._memory.flags[kind + self._place(camera)] = 0

    def _put_other(self, parts: Sequence[Bytes]) -> None:
        if not self._put(parts):
            self._dropped["worker_others_dropped"] += 1

    def _put(self, parts: Sequence[Bytes]) -> bool:
        """Copy one message into the ring; False where a live sink's is full."""
        assert self._memory is not None
        slots = self._memory.slots
        self._unpolled += 1
        if slots[shared_memory.MESSAGES] != self._polled or self._unpolled >= _POLL_EVERY:
            self._poll()
        if self._error is not None:
            raise self._error
        if not self._ring.offer(parts):
            if not self._lossless:
                return False
            self._wait_for_room(parts)
        # either we see that the worker sleeps or it sees the message
        fence()
        if slots[shared_memory.SLEEPS]:
            self._wake()
        return True

    def _wait_for_room(self, parts: Sequence[Bytes]) -> None:
        """Write a message as the worker makes room for it, also one larger than the ring."""
        assert self._memory is not None
        begin_s = monotonic_s()
        try:
            for part in parts:
                done = 0
                while done < len(part):
                    poured = self._ring.pour(part[done:])
                    done += poured
                    fence()
                    if self._memory.slots[shared_memory.SLEEPS]:
                        self._wake()
                    if not poured:
                        sleep_s(_NAP_S)
                        self._poll()
                        if self._error is not None:
                            raise self._error
        except BaseException:
            # nothing can follow the begin of a message, which the worker discards
            if self._error is None:
                self._torn = (
                    f"the {self._name} was interrupted in the middle of a packet: what came before "
                    "is there; start the run again to have it all"
                )
                self._error = SinkStoppedError(self._torn)
            raise
        finally:
            self._waits += 1
            self._waited_s += monotonic_s() - begin_s

    def _wake(self) -> None:
        """Wake the worker, by the one system call, which costs 8 us."""
        assert self._memory is not None
        assert self._process is not None
        self._memory.slots[shared_memory.SLEEPS] = 0
        if not self._process.wake():
            self._poll()

    def _poll(self) -> None:
        """Read the worker's messages, or find that it is no more."""
        assert self._memory is not None
        assert self._process is not None
        self._unpolled, self._polled = 0, self._memory.slots[shared_memory.MESSAGES]
        for message in self._process.poll():
            if "stopped" in message:
                self._error = SinkStoppedError(message["stopped"])
            elif "failed" in message:
                self._error = EvsError(message["failed"])
            elif "died" in message:
                self._error = SinkStoppedError(message["died"])
