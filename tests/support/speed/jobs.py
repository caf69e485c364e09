"""Jobs of the runner that write, fail, starve and die: processes of their own can import them."""

from __future__ import annotations

import hashlib
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.msgs import EvsError
from evs.tools.jobs import job_threads, report_progress


@dataclass(frozen=True)
class Noise:
    """Files whose bytes follow from the name's number alone, after `seconds`."""

    number: int
    kib: int = 1
    seconds: float = 0.0

    @property
    def name(self) -> str:
        return f"noise/{self.number:03d}"

    def make(self, folder: Path) -> None:
        rng = np.random.default_rng(self.number)
        (folder / "a.bin").write_bytes(rng.bytes(1024 * self.kib))
        (folder / "in").mkdir()
        (folder / "in" / "b.txt").write_text(f"{self.number}\n")
        time.sleep(self.seconds)
        (folder / "empty").touch()


@dataclass(frozen=True)
class One:
    """One file that bears the job's name, and says how many threads it may have used."""

    name: str

    def make(self, folder: Path) -> None:
        report_progress(0.5)
        (folder / self.name).write_text(f"{job_threads()}")


@dataclass(frozen=True)
class Dies:
    """Kills its process the first `times` times, with half a file written; counts in `marks`."""

    name: str
    marks: str
    times: int
    how: str = "kill"

    def make(self, folder: Path) -> None:
        tried = len(list(Path(self.marks).glob(f"{self.name}-*")))
        Path(self.marks, f"{self.name}-{tried}-{os.getpid()}").touch()
        (folder / f"half{tried}").write_text("half")
        if tried < self.times:
            if self.how == "starve":
                raise MemoryError
            if self.how == "exit":
                os._exit(7)
            os.kill(os.getpid(), signal.SIGKILL)
        (folder / "whole").write_text(self.name)


@dataclass(frozen=True)
class Fails:
    """Raises what it is told to."""

    name: str
    kind: str

    def make(self, folder: Path) -> None:
        (folder / "half").write_text("half")
        if self.kind == "evs":
            raise EvsError("the lamp is broken; take another")
        if self.kind == "disk":
            raise OSError(28, "No space left on device")
        if self.kind == "missing":
            (folder / "none" / "x").read_text()
        if self.kind == "odd":
            raise OddError(1, 2)
        raise ZeroDivisionError("by nothing")


class OddError(Exception):
    """An exception that pickle writes and cannot read."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(f"{first} and {second}")


@dataclass(frozen=True)
class Empty:
    """Writes nothing."""

    name: str

    def make(self, folder: Path) -> None:
        """Nothing."""


@dataclass(frozen=True)
class Link:
    """Writes what is no file."""

    name: str

    def make(self, folder: Path) -> None:
        (folder / "link").symlink_to("/")


@dataclass(frozen=True)
class Warns:
    """Warns, as libraries below do."""

    name: str

    def make(self, folder: Path) -> None:
        import warnings

        warnings.warn("the light is dim", RuntimeWarning, stacklevel=1)
        (folder / "x").touch()


def processes_of(session: int) -> list[int]:
    """Living processes of a session, by /proc."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found


def digests(folder: Path) -> dict[str, str]:
    """Every file below a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
