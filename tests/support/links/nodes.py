"""A Ray cluster of several nodes on this machine.

Each node is a process of `ray start` on a loopback address of its own, and ends with the block.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from speed.jobs import processes_of

STORE_BYTES = 80_000_000
"""the size of each node's object store; Ray accepts no less than 75 MB"""


class Nodes:
    """The nodes. Each is one `ray start` and all processes that it started."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self.port, self._port_lock = reserve_port()
        self.groups: list[int] = []

    @property
    def address(self) -> str:
        return f"127.0.0.2:{self.port}"

    def add(self, cores: int = 1, before: str = "") -> int:
        """Start a node.

        Args:
            cores: How many cores the node offers.
            before: A folder that its Python searches first.

        Returns:
            The place of the node: 0 for the head.
        """
        place = len(self.groups)
        head = ["--head", "--port", str(self.port), "--include-dashboard", "false"]
        words = [
            *(sys.executable, "-c", "from ray.scripts.scripts import main; main()", "start"),
            *(head if place == 0 else ["--address", self.address]),
            *("--node-ip-address", f"127.0.0.{place + 2}", "--num-cpus", str(cores)),
            *("--object-store-memory", str(STORE_BYTES), "--disable-usage-stats"),
        ]
        started = subprocess.Popen(
            words if place == 0 else words[:-1],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            env=self.environment(before),
        )
        said, _ = started.communicate(timeout=60)
        assert started.returncode == 0, said
        self.groups.append(started.pid)
        return place

    def environment(self, before: str = "") -> dict[str, str]:
        """Return the environment of the nodes, and of those who connect to them."""
        return {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path for path in (before, *sys.path) if path),
            # the paths of sockets stay short, and nothing is left elsewhere
            "RAY_TMPDIR": self.folder,
            "TMPDIR": self.folder,
            "RAY_USAGE_STATS_ENABLED": "0",
            # a node that is silent is dead after about 3 s, not half a minute
            "RAY_health_check_initial_delay_ms": "1000",
            "RAY_health_check_period_ms": "500",
            "RAY_health_check_timeout_ms": "1000",
            "RAY_health_check_failure_threshold": "3",
        }

    def kill(self, place: int) -> None:
        """Kill all processes of a node with SIGKILL."""
        self._signal(place, signal.SIGKILL)

    def kill_at_work(self, place: int) -> bool:
        """Kill a node if one of its workers runs a task, which therefore never ends.

        The node is stopped first: otherwise, a short task would end before the kill.

        Returns:
            Whether the node was killed.
        """
        self._signal(place, signal.SIGSTOP)
        if self.is_working(place):
            self.kill(place)
            return True
        self._signal(place, signal.SIGCONT)
        return False

    def is_working(self, place: int) -> bool:
        """Whether a worker of a node runs a task, by the title that Ray gives its process."""
        for pid in self.processes(place):
            try:
                title = Path(f"/proc/{pid}/cmdline").read_text()
            except OSError:
                continue
            if title.startswith("ray::") and not title.startswith("ray::IDLE"):
                return True
        return False

    def _signal(self, place: int, number: signal.Signals) -> None:
        for pid in self.processes(place):
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                continue

    def processes(self, place: int) -> list[int]:
        """Return the processes of one node: the session of its `ray start`."""
        return processes_of(self.groups[place])

    def end(self) -> None:
        """Kill all nodes, and wait until they are gone."""
        until_s = time.monotonic() + 10
        while any(self.processes(place) for place in range(len(self.groups))):
            assert time.monotonic() < until_s
            for place in range(len(self.groups)):
                self.kill(place)
            time.sleep(0.05)
        self._port_lock.close()


@contextmanager
def nodes(count: int) -> Iterator[Nodes]:
    """Run a cluster of `count` nodes, each with one core."""
    folder = tempfile.mkdtemp(prefix="evs-ray-", dir="/tmp")
    cluster = Nodes(folder)
    try:
        for _ in range(count):
            cluster.add()
        yield cluster
    finally:
        cluster.end()
        shutil.rmtree(folder, ignore_errors=True)


def reserve_port() -> tuple[int, IO[bytes]]:
    """Reserve a port that nobody listens on, outside the range that the system assigns by itself.

    It belongs to this cluster until the file is closed: tests run side by side, and a head binds
    its port only a second after it was chosen.

    Returns:
        The port, and the file that locks it.

    Raises:
        RuntimeError: If no port is free.
    """
    for port in range(26379, 26479):
        lock = Path(tempfile.gettempdir(), f"evs-ray-{port}.lock").open("wb")  # noqa: SIM115 - returned
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with socket.socket() as trial:
                trial.bind(("127.0.0.1", port))
        except OSError:
            lock.close()
            continue
        return port, lock
    raise RuntimeError("no port is free")
