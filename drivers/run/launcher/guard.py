"""The guard: a process that outlives the launcher and stops the nodes if the launcher is killed.

It has the other end of a socket, which closes with the launcher. It also has the reading end of
each node's output, so that no node dies of a broken pipe before it has closed its files.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from evs.drivers.clock import monotonic_s, sleep_s
from evs.msgs import EvsError

_LOOK_S = 0.05
_AFTER_S = 2.0
"""how long a node may take after SIGTERM, and after SIGKILL"""
_MESSAGE = 256
_READ_BYTES = 65536


class Guard:
    """The launcher's side: reports to the guard which nodes run."""

    def __init__(self) -> None:
        """Start the guard. Raises EvsError if this machine cannot start another process."""
        self._line, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._process = subprocess.Popen(
                # nothing that lies where it runs is imported by mistake
                [sys.executable, "-P", "-m", "evs.drivers.run.launcher.guard", str(other.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[other.fileno()],
                start_new_session=True,
            )
        except OSError as reason:
            self._line.close()
            raise EvsError(
                f"cannot start a process that watches over the launch: {reason.strerror}"
            ) from None
        finally:
            other.close()

    def watch(self, pid: int, output: int, alone_s: float, stop_s: float) -> None:
        """Report that a node has started.

        Args:
            pid: Of its process.
            output: File number of the pipe that it prints to.
            alone_s: How long it may take to end by itself once the nodes after it have, s.
            stop_s: How long it may take to end after SIGINT, s.
        """
        # the guard may have been killed, too
        with contextlib.suppress(OSError):
            socket.send_fds(self._line, [f"{pid} {alone_s} {stop_s}".encode()], [output])

    def ended(self, pid: int) -> None:
        """Report that a node has ended."""
        with contextlib.suppress(OSError):
            self._line.send(f"{pid}".encode())

    def close(self) -> None:
        """End the guard: all nodes have ended."""
        self._line.close()
        self._process.wait()


@dataclass
class _Watched:
    """A node, as the guard knows it."""

    pid: int
    output: int
    alone_s: float
    stop_s: float

    @property
    def is_there(self) -> bool:
        """Whether any process of its group runs."""
        try:
            os.killpg(self.pid, 0)
            # a zombie whose parent is gone has ended
            state = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()[0]
        except ProcessLookupError:
            return False
        except OSError:
            # not on Linux, or its group lives on without it
            return True
        return state not in "ZX"

    def end(self) -> None:
        """Stop it, as the launcher would."""
        self._wait(self.alone_s)
        for number, patience_s in (
            (signal.SIGINT, self.stop_s),
            (signal.SIGTERM, _AFTER_S),
            (signal.SIGKILL, _AFTER_S),
        ):
            if not self.is_there:
                break
            self._signal(number)
            self._wait(patience_s)
        # processes that it left behind
        self._signal(signal.SIGKILL)

    def _signal(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, number)

    def _wait(self, patience_s: float) -> None:
        deadline_s = monotonic_s() + patience_s
        while self.is_there and monotonic_s() < deadline_s:
            sleep_s(_LOOK_S)

    def drain(self) -> None:
        """Read its output until it ends."""
        with contextlib.suppress(OSError):
            while os.read(self.output, _READ_BYTES):
                continue


def main(line: socket.socket) -> None:
    """Follow which nodes run until the launcher's socket closes; then stop them, the last first."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    nodes: dict[int, _Watched] = {}
    while True:
        message, outputs, _, _ = socket.recv_fds(line, _MESSAGE, 1)
        if not message:
            break
        pid, *patience = message.split()
        if patience:
            alone_s, stop_s = map(float, patience)
            nodes[int(pid)] = _Watched(int(pid), outputs[0], alone_s, stop_s)
        else:
            os.close(nodes.pop(int(pid)).output)
    if nodes:
        with contextlib.suppress(OSError):
            sys.stderr.write("launch: the launcher was killed: stopping every node\n")
            sys.stderr.flush()
    for node in nodes.values():
        threading.Thread(target=node.drain, daemon=True).start()
    for node in reversed(nodes.values()):
        node.end()


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
