"""The other process of a sink aside, as the camera has it: started, asked, seen to end."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from evs.drivers.run.worker.lines import Lines
from evs.drivers.run.worker.shared_memory import SharedMemory
from evs.msgs import EvsError

PROGRAM = "evs.drivers.run.worker.child"

_END_S = 10.0
"""How long a process that has said all, or has nothing to do any more, may take to end."""


class SinkProcess:
    """A process that has a sink. It is told to end by our hanging up, which our death does too."""

    def __init__(self, memory: SharedMemory, name: str) -> None:
        """Start it; in: memory, its control part and ring; name, of the sink, for people."""
        self._name = name
        self._opened = False
        ours, theirs = socket.socketpair()
        self._lines = Lines(ours)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", PROGRAM, str(theirs.fileno()), str(memory.number)],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": _search_path()},
                pass_fds=(theirs.fileno(), memory.number),
                # Ctrl-C and a closing terminal are the camera's to deal with: what it has handed
                # over is still to be written
                start_new_session=True,
            )
        except OSError as reason:
            ours.close()
            raise EvsError(
                f"cannot start a process for the {name}: {reason.strerror}; leave aside out"
            ) from None
        finally:
            theirs.close()

    @property
    def number(self) -> int:
        """Its process number."""
        return self._process.pid

    def open(self, **setup: Any) -> None:
        """Have the sink made and opened, and wait for that. EvsError with the line it said."""
        with suppress(OSError):
            self._lines.say(**setup)
        said = self._lines.next() or self._died()
        if "opened" not in said:
            raise EvsError(said.get("failed") or said["died"])
        self._opened = True

    def wake(self) -> bool:
        """End its sleep; False where it is no more."""
        try:
            self._lines.link.send(b"\0", socket.MSG_DONTWAIT)
        except BlockingIOError:
            # it has more than enough to wake up from
            return True
        except OSError:
            return False
        return True

    def heard(self) -> list[dict[str, Any]]:
        """What it has said; `died`, a line, stands for what it can say no more."""
        heard = self._lines.heard()
        return [*heard, self._died()] if self._lines.gone else heard

    def close(self) -> dict[str, Any]:
        """Hang up; it writes what it has, closes the sink and says how that went (`said`)."""
        found: dict[str, Any] = {}
        try:
            with suppress(OSError):
                self._lines.link.shutdown(socket.SHUT_WR)
            while self._opened and (said := self._lines.next()) is not None:
                found |= said
            if self._opened and "said" not in found:
                found |= self._died()
        finally:
            self._lines.link.close()
        self._end()
        return found

    def _died(self) -> dict[str, Any]:
        """Why it is no more, in one line."""
        self._end()
        code = self._process.returncode
        how = f"was ended by signal {-code}" if code is not None and code < 0 else f"ended ({code})"
        return {
            "died": f"the process of the {self._name} {how}: what it wrote until then is there, "
            "what comes now is not; start the run again to have it all"
        }

    def _end(self) -> None:
        """It has nothing left to do; if it does not end for that, it is stuck."""
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _search_path() -> str:
    """Where modules are found here, so that the other process finds the same."""
    return os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
