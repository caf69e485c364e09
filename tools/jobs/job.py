"""Jobs: what a job is, its result, the context in which it runs, and how it is run once."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError


class Job(Protocol):
    """A frozen dataclass in a module, so that it can be pickled for other processes."""

    @property
    def name(self) -> str:
        """Path of the result below the target folder, such as `00012.npz` or `night/0003`."""

    def make(self, folder: Path) -> None:
        """Write the files into an empty folder, and nothing anywhere else.

        The folder becomes `target/name`. A single file with the last part of the name becomes that
        file instead. The content must depend only on the job's fields, because a job may run twice.
        `job_threads` returns the threads that it may use; `report_progress` reports its progress.

        Args:
            folder: an empty folder.

        Raises:
            EvsError: the job cannot be done.
        """


@dataclass(frozen=True)
class JobSummary:
    """The result of run_jobs."""

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


@dataclass(frozen=True)
class JobMaker:
    """Runs a job in a new folder below `staging`."""

    staging: Path

    def __call__(self, job: Job) -> Path:
        """Run the job.

        Returns:
            The folder with its files.

        Raises:
            EvsError: the job failed; the message names it.
        """
        folder = self.staging / job.name
        # a worker that died may have left half of it
        shutil.rmtree(folder, ignore_errors=True)
        try:
            folder.mkdir(parents=True)
            job.make(folder)
        except EvsError as reason:
            raise EvsError(f"{job.name}: {reason}") from None
        except OSError as reason:
            text = reason.strerror or str(reason)
            where = f": '{reason.filename}'" if reason.filename else ""
            raise EvsError(f"{job.name}: {text}{where}{remedy_for(reason)}") from None
        except Exception as error:
            error.add_note(f"in job {job.name}")
            raise
        return folder


def remedy_for(reason: OSError) -> str:
    """What to do if the disk is full, for the end of a message; empty for other errors."""
    if reason.errno not in (errno.ENOSPC, errno.EDQUOT):
        return ""
    return "; the jobs before it are whole: free some space and give the command again"


REPORT_INTERVAL_S = 0.1
"""shortest time between two progress reports"""


@dataclass
class JobContext:
    """The context of the job that this process runs; one at a time."""

    threads: int = 0
    report: Callable[[float], None] = lambda _: None
    reported_s: float = -REPORT_INTERVAL_S


_context = JobContext()


@contextmanager
def job_context(threads: int, report: Callable[[float], None]) -> Iterator[None]:
    """Run a job in this block.

    Args:
        threads: worker threads that the job may use.
        report: receives its progress, 0 ... 1.
    """
    global _context
    before, _context = _context, JobContext(threads, report)
    try:
        yield
    finally:
        _context = before


def job_threads() -> int:
    """Worker threads that the running job may use; 0: one per core."""
    return _context.threads


def report_progress(share: float) -> None:
    """Report how much of the running job is done. It is cheap: call it as often as you like.

    A cluster does not forward it.

    Args:
        share: 0 ... 1.
    """
    now_s = monotonic_s()
    if now_s - _context.reported_s >= REPORT_INTERVAL_S:
        _context.reported_s = now_s
        _context.report(share)
