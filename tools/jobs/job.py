"""Job: a named pure function that writes files. JobSummary: the result of a set of jobs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from evs.msgs import EvsError


class Job(Protocol):
    """A frozen dataclass of a module, so that pickle can send it to a process or machine."""

    @property
    def name(self) -> str:
        """Path of the result below the target folder, such as `00012.npz` or `night/0003`."""

    def make(self, folder: Path) -> None:
        """Write the files into an empty folder, and nothing anywhere else.

        The folder becomes `target/name`. A single file with the last part of the name becomes that
        file instead. The content must follow from the job's fields: a job may run twice.
        `job_threads` returns the threads that it may use; `report_progress` reports its progress.

        Args:
            folder: an empty folder.

        Raises:
            EvsError: the job cannot be done.
        """


@dataclass(frozen=True)
class JobSummary:
    """What run_jobs did."""

    made: int
    """jobs that ran"""
    kept: int
    """jobs whose results existed"""
    left: int
    """jobs that did not run because the caller stopped"""
    lost: tuple[str, ...] = ()
    """one line for each worker or node that died; its job was run again"""


def check_names(names: Iterable[str]) -> None:
    """Check job names.

    Raises:
        EvsError: a name is not a path below the target, or two jobs share it.
    """
    seen: set[str] = set()
    for name in names:
        parts = name.split("/")
        if any(not part or part.startswith(".") or "\0" in part for part in parts):
            raise EvsError(f"job '{name}': its name must be a path below the target folder")
        if name in seen:
            raise EvsError(f"job '{name}' is there twice; each needs a name of its own")
        seen.add(name)
    for name in seen:
        for end in (place for place, sign in enumerate(name) if sign == "/"):
            if name[:end] in seen:
                raise EvsError(f"job '{name}' lies inside job '{name[:end]}'; name one anew")
