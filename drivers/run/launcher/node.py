"""One program of a launch: its process, and what it prints, line by line."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable

from evs.drivers.clock import monotonic_s
from evs.drivers.run.launcher.guard import Guard
from evs.drivers.run.launcher.plan import NodeConfig
from evs.msgs import EvsError

LONGEST_LINE = 64 * 1024
"""A longer one is cut in two."""

LAST_PACKETS_S = 3.0
"""how long a subscriber may take to end by itself once its publishers have"""

_STOPPED_CODES = {0, 128 + signal.SIGINT, 128 + signal.SIGTERM}
"""exit codes of a program that stopped on request"""
_READ_ON_S = 2.0
"""how long the pipe of a node that ended is read: a process that it started may keep it open"""


class Node:
    """A program that may be started, stopped and started again. One thread uses it."""

    def __init__(
        self, config: NodeConfig, say: Callable[[str, str], None], guard: Guard | None = None
    ) -> None:
        """Make a node that is not started.

        Args:
            config: The program.
            say: Called from another thread with (name, line) for each line that it prints.
            guard: Stops it if this process is killed.
        """
        self.config = config
        self.alone_s = LAST_PACKETS_S if config.subscribes and not config.publishes else 0.0
        """How long it may take to end by itself once its publishers have, s."""
        self.restarts = 0
        """How often it was started again."""
        self.code: int | None = None
        """Exit code of its last run, 128 + n after signal n; None: it runs or never did."""
        self.stop_requested = False
        """Whether it was asked to stop."""
        self.again_s: float | None = None
        """When it is to start again, on the monotonic clock."""
        self.since_s = 0.0
        """When it started; 0: it did not, or its end has been reported."""
        self._say, self._guard = say, guard
        self._process: subprocess.Popen[bytes] | None = None
        self._reader: threading.Thread | None = None

    @property
    def running(self) -> bool:
        """Whether its process runs; notices its end."""
        if self._process is None:
            return False
        code = self._process.poll()
        if code is None:
            return True
        # every line of it is reported before its end
        if self._reader is not None:
            self._reader.join(_READ_ON_S)
        self.code = code if code >= 0 else 128 - code
        if self._guard is not None:
            self._guard.ended(self._process.pid)
        self._process = None
        return False

    @property
    def failed(self) -> bool:
        """Whether it ended with an error; the exit code of a requested stop is none."""
        return self.code is not None and self.code not in (
            _STOPPED_CODES if self.stop_requested else {0}
        )

    def start(self) -> None:
        """Start it. Raises EvsError if there is no such program."""
        try:
            self._process = subprocess.Popen(
                command_of(again(self.config.run) if self.restarts else self.config.run),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={
                    **os.environ,
                    "PYTHONUNBUFFERED": "1",
                    **dict(word.split("=", 1) for word in self.config.env),
                },
                cwd=self.config.folder or None,
                # Ctrl-C is for the launch, which stops its nodes in order
                start_new_session=True,
            )
        except OSError as reason:
            raise EvsError(
                f"node '{self.config.name}': cannot run '{self.config.run[0]}': {reason.strerror}"
            ) from None
        self.code, self.again_s, self.since_s = None, None, monotonic_s()
        if self._guard is not None:
            assert self._process.stdout is not None
            output = self._process.stdout.fileno()
            self._guard.watch(self._process.pid, output, self.alone_s, self.config.stop_s)
        self._reader = threading.Thread(target=self._read, args=(self._process,), daemon=True)
        self._reader.start()

    def signal(self, number: int) -> None:
        """Send a signal to it and to all that it started."""
        self.stop_requested = True
        if self._process is not None and self._process.poll() is None:
            try:
                os.killpg(self._process.pid, number)
            except ProcessLookupError:
                # it ended meanwhile
                return

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout as output:
            while line := output.readline(LONGEST_LINE):
                text = line.decode(errors="replace").rstrip("\r\n")
                # of a progress line that is written over and over, the last state
                self._say(self.config.name, text.rpartition("\r")[2])


def again(run: tuple[str, ...]) -> tuple[str, ...]:
    """Return the words of a program that starts again, so that earlier recordings stay."""
    command = run[1] if run[0] == "evs" and len(run) > 1 else ""
    if command == "record":
        return (*run, "--beside")
    if command == "emulate" or (command == "loop" and "--serve" in run):
        return (*run, "beside=true")
    return run


def command_of(run: tuple[str, ...]) -> list[str]:
    """Return the command for these words; `evs` and `python` are those that run now."""
    program, *words = run
    if program == "evs":
        # as the installed command: nothing that lies where it runs is imported by mistake
        return [sys.executable, "-P", "-m", "evs.launch.main", *words]
    if program == "python":
        return [sys.executable, *words]
    return [shutil.which(program) or program, *words]
