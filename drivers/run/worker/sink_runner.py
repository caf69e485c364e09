"""The sink in its worker: runs what the messages say, publishes what the sink wants, closes it."""

from __future__ import annotations

import sys
import traceback
from contextlib import suppress
from typing import Any

from evs.drivers.run.sink_set import disk_errors
from evs.drivers.run.worker import shared_memory
from evs.drivers.run.worker.control_channel import ControlChannel
from evs.drivers.run.worker.messages import Light, Message, TruthOf
from evs.drivers.run.worker.shared_memory import SharedMemory
from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, Pace, Pose, TriggerPacket


class SinkRunner:
    """Writes messages to an open sink; after an error of it they are discarded."""

    def __init__(
        self, sink: Sink, cameras: tuple[str, ...], shared: SharedMemory, channel: ControlChannel
    ) -> None:
        self.cameras = cameras
        self._sink, self._channel = sink, channel
        self._slots, self._flags = shared.slots, shared.flags
        self._failed = False

    def run(self, message: Message) -> None:
        """Write one message, then publish what the sink wants next."""
        if self._failed:
            return
        try:
            with disk_errors():
                self._write(message)
                self._update_due(message)
        except SinkStoppedError as error:
            self._fail(stopped=str(error))
        except EvsError as error:
            self._fail(failed=str(error))
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            self._fail(failed=f"{type(error).__name__}: {error}")

    def update_wants(self) -> None:
        """Publish what the sink wants of the camera, whatever comes to it."""
        if self._failed:
            return
        if Stream.POSE in self._sink.streams:
            for place, camera in enumerate(self.cameras):
                self._flags[shared_memory.POSE + place] = self._sink.wants_pose(camera)
        if self._sink.stop_wanted:
            self._slots[shared_memory.STOP] = 1

    def close(self) -> None:
        """Close the sink and send its report, if the camera's process is still there."""
        message: dict[str, Any]
        try:
            with disk_errors():
                message = {"report": self._sink.close()}
        except EvsError as error:
            message = {"report": {}, "failed": str(error)}
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            message = {"report": {}, "failed": f"{type(error).__name__}: {error}"}
        with suppress(OSError):
            self._channel.send(**message)

    def _write(self, message: Message) -> None:
        sink = self._sink
        match message:
            case EventPacket():
                sink.write(message)
            case Frame():
                sink.write_frame(message)
            case ImuPacket():
                sink.write_imu(message)
            case TriggerPacket():
                sink.write_triggers(message)
            case Pose():
                sink.write_pose(message)
            case Pace():
                sink.write_pace(message)
            case TruthOf(camera, truth):
                sink.write_truth(camera, truth)
            case Light(camera, t_us, luminance):
                sink.write_light(camera, t_us, luminance)

    def _update_due(self, message: Message) -> None:
        """Once a packet of events: what is due now comes with a later tick."""
        if not isinstance(message, EventPacket):
            return
        camera, t_us = message.camera, message.time_end_us
        place, streams = self.cameras.index(camera), self._sink.streams
        if Stream.GROUND_TRUTH in streams and self._sink.wants_truth(camera, t_us):
            self._flags[shared_memory.TRUTH + place] = 1
        if Stream.LIGHT in streams and self._sink.wants_light(camera, t_us):
            self._flags[shared_memory.LIGHT + place] = 1
        self.update_wants()

    def _fail(self, **message: str) -> None:
        self._failed = True
        self._flags[shared_memory.POSE : shared_memory.LIGHT + shared_memory.MAX_CAMERAS] = bytes(
            3 * shared_memory.MAX_CAMERAS
        )
        with suppress(OSError):
            self._channel.send(**message)
        self._slots[shared_memory.MESSAGES] += 1
