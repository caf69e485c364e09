"""The worker's process, as the camera's process has it: started, polled, waited for."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import suppress
from typing import Any

from evs.drivers.run.worker.control_channel import ControlChannel
from evs.drivers.run.worker.shared_memory import SharedMemory
from evs.drivers.search_path import search_path
from evs.msgs import EvsError

PROGRAM = "evs.drivers.run.worker.program"

_END_S = 10.0
"""How long a process that has nothing left to do may take to end."""


class WorkerProcess:
    """A process that has a sink. Hanging up ends it, as this process's own end does."""

    def __init__(self, memory: SharedMemory, name: str) -> None:
        """Start the process.

        Args:
            memory: The control part and the ring.
            name: Of the sink, for people.
        """
        self._name = name
        self._opened = False
        ours, theirs = socket.socketpair()
        self._channel = ControlChannel(ours)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", PROGRAM, str(theirs.fileno()), str(memory.number)],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": search_path()},
                pass_fds=(theirs.fileno(), memory.number),
                # Ctrl-C and a closing terminal are the camera's to deal with: what it has handed
                # over is still to be written
                start_new_session=True,
            )
        except OSError as reason:
            ours.close()
            raise EvsError(
                f"cannot start a process for the {name}: {reason.strerror}; leave worker out"
            ) from None
        finally:
            theirs.close()

    @property
    def number(self) -> int:
        """Its process number."""
        return self._process.pid

    def open(self, **setup: Any) -> None:
        """Have the sink made and opened, and wait for that. EvsError with its line."""
        with suppress(OSError):
            self._channel.send(**setup)
        answer = self._channel.receive() or self._died()
        if "opened" not in answer:
            raise EvsError(answer.get("failed") or answer["died"])
        self._opened = True

    def wake(self) -> bool:
        """End its sleep; False where the process is no more."""
        try:
            self._channel.link.send(b"\0", socket.MSG_DONTWAIT)
        except BlockingIOError:
            # it has more than enough to wake up from
            return True
        except OSError:
            return False
        return True

    def poll(self) -> list[dict[str, Any]]:
        """Return the messages that have come; the last has `died`, a line, once it is no more."""
        messages = self._channel.poll()
        return [*messages, self._died()] if self._channel.closed else messages

    def close(self) -> dict[str, Any]:
        """Hang up; it writes what it has, closes the sink and sends its `report`."""
        found: dict[str, Any] = {}
        try:
            with suppress(OSError):
                self._channel.link.shutdown(socket.SHUT_WR)
            while self._opened and (message := self._channel.receive()) is not None:
                found |= message
            if self._opened and "report" not in found:
                found |= self._died()
        finally:
            self._channel.link.close()
        self._end()
        return found

    def _died(self) -> dict[str, Any]:
        """The message that it is no more, and why."""
        self._end()
        code = self._process.returncode
        how = f"was ended by signal {-code}" if code is not None and code < 0 else f"ended ({code})"
        return {
            "died": f"the process of the {self._name} {how}: what it wrote until then is there, "
            "what comes now is not; start the run again to have it all"
        }

    def _end(self) -> None:
        """Wait for its end; a process that has nothing left to do and does not end is stuck."""
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
