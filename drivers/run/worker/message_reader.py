"""The reading end of the ring: whole messages one by one, sleep where there are none."""

from __future__ import annotations

import os
import select
import socket
from collections.abc import Callable
from typing import Any

import numpy as np

from evs.drivers.clock import sleep_s
from evs.drivers.run.worker import messages, shared_memory
from evs.drivers.run.worker.ring import RingReader
from evs.drivers.run.worker.shared_memory import SharedMemory, fence

_NAP_S = 0.0004
"""A wake-up costs the camera 8 us, a nap costs it nothing and comes this much later at most."""
_NAPS = 25
"""After so many in vain it is left to the camera to wake this process."""
_SLEEP_MS = 100
"""A sleep ends after this even if nobody wakes it."""


class TornError(Exception):
    """The camera's process is gone, and what is left in the ring is no whole message."""


class MessageReader:
    """Reads messages. TornError after the last."""

    def __init__(self, shared: SharedMemory, link: socket.socket) -> None:
        self._slots, self._ring, self._link = shared.slots, RingReader(shared), link
        self._parent = os.getppid()
        self._gone = False
        self._poller = select.poll()
        self._poller.register(link, select.POLLIN)
        self._idle: Callable[[], None] = lambda: None

    def message(self, cameras: tuple[str, ...], idle: Callable[[], None]) -> messages.Message:
        """Wait for the next one; `idle` is called now and then while none comes."""
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
        """Wait until there is something to read. TornError: there never will be."""
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
