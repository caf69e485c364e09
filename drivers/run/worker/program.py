"""The worker's program: reads messages from the ring and writes them to the sink.

It ends when the camera's process closes the socket or dies, after it has written everything that is
in the ring.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from evs.drivers.clock import sleep_s
from evs.drivers.run.sink_set import disk_errors
from evs.drivers.run.worker import messages, shared_memory
from evs.drivers.run.worker.control_channel import ControlChannel
from evs.drivers.run.worker.messages import Light, Message, TruthOf
from evs.drivers.run.worker.shared_memory import RingReader, SharedMemory, fence
from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, Pace, Pose, StreamInfo, TriggerPacket

_NAP_S = 0.0004
"""A wake-up costs the camera 8 us, a nap costs it nothing and comes this much later at most."""
_NAPS = 25
"""After so many without a message this process sleeps until the camera wakes it."""
_SLEEP_MS = 100
"""A sleep ends after this even if nobody wakes it."""
_POLL_MS = 100
"""Between two checks, while the sink opens, whether the camera's process is still there."""


class TornError(Exception):
    """The camera's process is gone, and what is left in the ring is no whole message."""


class MessageReader:
    """Reads messages from the ring; sleeps while there are none. TornError after the last."""

    def __init__(self, shared: SharedMemory, link: socket.socket) -> None:
        self._slots, self._ring, self._link = shared.slots, RingReader(shared), link
        self._parent = os.getppid()
        self._gone = False
        self._poller = select.poll()
        self._poller.register(link, select.POLLIN)
        self._idle: Callable[[], None] = lambda: None

    def message(self, cameras: tuple[str, ...], idle: Callable[[], None]) -> messages.Message:
        """Wait for the next message; call `idle` now and then while none comes."""
        self._idle = idle
        return messages.receive(self._read, cameras)

    def _read(self, count: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
        array = np.empty(count, np.uint8)
        target, done = array.data, 0
        while done < count:
            taken = self._ring.take(target[done:])
            done += taken
            if not taken:
                self._wait()
        return array

    def _wait(self) -> None:
        """Wait until there is something to read. Raises TornError if nothing can come any more."""
        if self._gone:
            raise TornError
        for _ in range(_NAPS):
            sleep_s(_NAP_S)
            if self._ring.waiting:
                return
        while not self._gone:
            # set before the ring is read: either we see the message or the camera sees this
            self._slots[shared_memory.SLEEPS] = 1
            fence()
            if self._ring.waiting:
                self._slots[shared_memory.SLEEPS] = 0
                return
            if self._poller.poll(_SLEEP_MS):
                self._drain_wakes()
            elif os.getppid() != self._parent:
                # another process may still hold its end of the socket
                self._gone = True
            self._slots[shared_memory.SLEEPS] = 0
            if self._ring.waiting:
                return
            self._idle()

    def _drain_wakes(self) -> None:
        try:
            self._gone = not self._link.recv(4096, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            self._gone = True


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
                if isinstance(message, EventPacket):
                    self.update_due(message.camera, message.time_end_us)
                    self.update_wants()
        except SinkStoppedError as error:
            self._fail(stopped=str(error))
        except EvsError as error:
            self._fail(failed=str(error))
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            self._fail(failed=f"{type(error).__name__}: {error}")

    def update_wants(self) -> None:
        """Publish what the sink wants of the camera, apart from what events make due."""
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

    def update_due(self, camera: str, t_us: int) -> None:
        """Publish what is due of a camera at the end of a tick; it comes with a later tick.

        Args:
            camera: Name of the camera.
            t_us: Simulated time at the end of the tick, us.
        """
        place, streams = self.cameras.index(camera), self._sink.streams
        if Stream.GROUND_TRUTH in streams and self._sink.wants_truth(camera, t_us):
            self._flags[shared_memory.TRUTH + place] = 1
        if Stream.LIGHT in streams and self._sink.wants_light(camera, t_us):
            self._flags[shared_memory.LIGHT + place] = 1

    def _fail(self, **message: str) -> None:
        self._failed = True
        self._flags[shared_memory.POSE : shared_memory.LIGHT + shared_memory.MAX_CAMERAS] = bytes(
            3 * shared_memory.MAX_CAMERAS
        )
        with suppress(OSError):
            self._channel.send(**message)
        self._slots[shared_memory.MESSAGES] += 1


class _AbandonedError(BaseException):
    """The camera's process ended while the sink was opening."""


def main(link: int, number: int) -> None:
    """Serve the ring until the camera's process closes the socket.

    Args:
        link: File number of the socket.
        number: File number of the shared memory.
    """
    # signals are for the camera's process, which ends this one by hanging up
    for ignored in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    with socket.socket(fileno=link) as ours, SharedMemory.attach(number) as memory:
        channel = ControlChannel(ours)
        setup = channel.receive()
        if setup is None:
            return
        try:
            sink, streams = _open(ours, setup)
        except _AbandonedError:
            return
        except EvsError as error:
            with suppress(OSError):
                channel.send(failed=str(error))
            return
        reader = MessageReader(memory, ours)
        runner = SinkRunner(sink, tuple(stream.camera for stream in streams), memory, channel)
        runner.update_wants()
        # known before the first tick, however far the camera is ahead of us later
        for stream in streams:
            runner.update_due(stream.camera, stream.start_us + stream.tick_us)
        with suppress(OSError):
            channel.send(opened=True)
        try:
            while True:
                runner.run(reader.message(runner.cameras, runner.update_wants))
        except TornError:
            # nothing more comes
            runner.close()


def _open(link: socket.socket, setup: dict[str, Any]) -> tuple[Sink, list[StreamInfo]]:
    """Make the sink and open it. Raises EvsError as both do."""
    from evs.drivers.sink_config import SinkConfig
    from evs.emulator.config import decoding

    if setup["cores"] is not None:
        if not hasattr(os, "sched_setaffinity"):
            raise EvsError("worker_cores needs Linux: leave it out")
        try:
            os.sched_setaffinity(0, setup["cores"])
        except OSError:
            have = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
            raise EvsError(f"worker_cores is {setup['cores']}: choose of {have}") from None
    streams = [StreamInfo(**stream) for stream in setup["streams"]]
    with _unless_abandoned(link), disk_errors():
        sink = decoding.build(SinkConfig, setup["sink"]).make()
        try:
            sink.open(streams)
        except BaseException:
            # one that failed to open may hold something already
            with suppress(Exception):
                sink.close()
            raise
    return sink, streams


@contextmanager
def _unless_abandoned(link: socket.socket) -> Iterator[None]:
    """End whatever the sink waits for, as subscribers, when the camera's process ends."""
    done = threading.Event()
    main_thread = threading.get_ident()

    def abandon(*_: object) -> None:
        if not done.is_set():
            raise _AbandonedError

    def watch() -> None:
        poller = select.poll()
        poller.register(link, select.POLLIN)
        while not done.is_set():
            if poller.poll(_POLL_MS) and not link.recv(1, socket.MSG_PEEK):
                # it interrupts whatever the sink waits in
                signal.pthread_kill(main_thread, signal.SIGUSR1)
                return

    signal.signal(signal.SIGUSR1, abandon)
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()
        signal.signal(signal.SIGUSR1, signal.SIG_IGN)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
