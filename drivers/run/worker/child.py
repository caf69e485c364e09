"""The program of a sink aside: takes packets out of the ring and gives them to the sink.

Ends when the other side hangs up or is no more, after all that it handed over is written.
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
from evs.drivers.run.worker.inlet import Inlet, TornError
from evs.drivers.run.worker.lines import Lines
from evs.drivers.run.worker.outlet import Outlet
from evs.drivers.run.worker.shared_memory import SharedMemory
from evs.drivers.sink import Sink
from evs.msgs import EvsError, StreamInfo

_LOOK_MS = 100


class _AbandonedError(BaseException):
    """The other side went while the sink was opening."""


def main(link: int, number: int) -> None:
    """Serve the ring in the file `number` until the socket `link` ends."""
    # who ends the camera's process ends this one: by hanging up
    for ignored in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    with socket.socket(fileno=link) as ours, SharedMemory.attach(number) as memory:
        lines = Lines(ours)
        setup = lines.next()
        if setup is None:
            return
        try:
            sink, streams = _open(ours, setup)
        except _AbandonedError:
            return
        except EvsError as error:
            with suppress(OSError):
                lines.say(failed=str(error))
            return
        inlet = Inlet(memory, ours)
        outlet = Outlet(sink, tuple(stream.camera for stream in streams), memory, lines)
        outlet.look()
        with suppress(OSError):
            lines.say(opened=True)
        try:
            while True:
                outlet.give(inlet.message(outlet.cameras, outlet.look))
        except TornError:
            # nothing more comes
            outlet.close()


def _open(link: socket.socket, setup: dict[str, Any]) -> tuple[Sink, list[StreamInfo]]:
    """The sink, opened. EvsError as making and opening it raise."""
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
    """Waiting for subscribers, say, ends with the other side."""
    done = threading.Event()
    main_thread = threading.get_ident()

    def abandon(*_: object) -> None:
        if not done.is_set():
            raise _AbandonedError

    def watch() -> None:
        poller = select.poll()
        poller.register(link, select.POLLIN)
        while not done.is_set():
            if poller.poll(_LOOK_MS) and not link.recv(1, socket.MSG_PEEK):
                # it wakes whatever the sink waits in
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
