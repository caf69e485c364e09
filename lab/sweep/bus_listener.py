"""A subscriber in its own process for all runs of a sweep: the bus does nothing without one.

The process runs this file as a program until it is killed or its parent is gone.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from types import TracebackType

from evs.drivers.bus import subscribe
from evs.drivers.bus.address import free_address


class BusListener:
    """The process as a context; `address` is where publishers are to bind."""

    def __init__(self) -> None:
        self.address = free_address()

    def __enter__(self) -> BusListener:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "evs_lab.sweep.bus_listener", self.address],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            # Ctrl-C is for the sweep; this process ends when its input does
            start_new_session=True,
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()


def listen(address: str) -> None:
    """Receive everything, stream after stream, until the process is killed."""
    while True:
        with subscribe(address) as subscription:
            for _packet in subscription:
                pass


if __name__ == "__main__":
    threading.Thread(target=listen, args=(sys.argv[1],), daemon=True).start()
    # the parent holds the other end and never writes
    sys.stdin.read()
