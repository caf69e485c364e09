"""The worker's program: reads messages from the ring and writes them to the sink.

Ends when the camera's process hangs up or dies, after everything that it handed over is written.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from evs.drivers.run.sink_set import disk_errors
from evs.drivers.run.worker.control_channel import ControlChannel
from evs.drivers.run.worker.message_reader import MessageReader, TornError
from evs.drivers.run.worker.shared_memory import SharedMemory
from evs.drivers.run.worker.sink_runner import SinkRunner
from evs.drivers.sink import Sink
from evs.msgs import EvsError, StreamInfo

_POLL_MS = 100


class _AbandonedError(BaseException):
    """The camera's process ended while the sink was opening."""


def main(link: int, number: int) -> None:
    """Serve the ring in the file `number` until the socket `link` ends."""
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
        with suppress(OSError):
            channel.send(opened=True)
        try:
            while True:
                runner.run(reader.message(runner.cameras, runner.update_wants))
        except TornError:
            # nothing more comes
            runner.close()


def _open(link: socket.socket, setup: dict[str, Any]) -> tuple[Sink, list[StreamInfo]]:
    """Make the sink and open it. EvsError as both raise."""
    from evs.drivers import settings
    from evs.drivers.run.config import SinkConfig, make_sink

    if setup["cores"] is not None:
        try:
            os.sched_setaffinity(0, setup["cores"])
        except OSError:
            have = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
            raise EvsError(f"aside_cores is {setup['cores']}: choose of {have}") from None
    streams = [StreamInfo(**stream) for stream in setup["streams"]]
    with _unless_abandoned(link), disk_errors():
        sink = make_sink(settings.build(SinkConfig, setup["sink"]))
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
    """Whatever the sink waits for, as for subscribers, ends with the camera's process."""
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
