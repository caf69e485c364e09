"""run_jobs: bring a set of jobs to a folder, each whole or not at all, and none twice."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from evs.drivers.runner.job import Job, Ran, check_names
from evs.drivers.runner.target import Target
from evs.drivers.runner.work import work_off
from evs.msgs import EvsError

JobT = TypeVar("JobT", bound=Job)


def run_jobs(
    jobs: Sequence[JobT],
    target: Path,
    *,
    workers: int = 1,
    threads: int = 0,
    on_done: Callable[[JobT, bool], None] = lambda _job, _is_new: None,
    on_share: Callable[[JobT, float], None] = lambda _job, _share: None,
    on_lost: Callable[[str], None] = warnings.warn,
    stopped: Callable[[], bool] = lambda: False,
) -> Ran:
    """Make the jobs whose `target/name` is not there yet. The same bytes, whoever makes them.

    In: workers, processes that work at once, 1: this one does; threads, of each job, 0: its share
    of the cores; on_done, told each job when it is there, and whether it is new; on_share, told how
    far a running job is, 0 ... 1; on_lost, told a line when a worker dies and its job is made
    elsewhere; stopped, asked before each job: those that run are still brought home.
    Raises EvsError, which names the job; the jobs that arrived before stay.
    """
    check_names(job.name for job in jobs)
    goal = Target(target)
    lost: list[str] = []

    def tell_lost(line: str) -> None:
        lost.append(line)
        on_lost(line)

    todo, kept = [], 0
    for job in jobs:
        if goal.has(job.name):
            on_done(job, False)
            kept += 1
        else:
            todo.append(job)
    made = 0
    if todo:
        with (
            goal.making() as making,
            # closed at once where on_done raises: no worker writes into what is removed
            closing(
                work_off(
                    todo,
                    MakeIn(making),
                    workers,
                    threads=threads,
                    stopped=stopped,
                    on_lost=tell_lost,
                    on_share=on_share,
                )
            ) as done,
        ):
            for job, folder in done:
                goal.arrive(job.name, folder)
                shutil.rmtree(folder, ignore_errors=True)
                made += 1
                on_done(job, True)
    return Ran(made, kept, len(jobs) - made - kept, tuple(lost))


@dataclass(frozen=True)
class MakeIn:
    """Makes a job in a new folder below `making`."""

    making: Path

    def __call__(self, job: Job) -> Path:
        """That folder. Raises EvsError, which names the job."""
        folder = self.making / job.name
        # a worker that died may have left half of it
        shutil.rmtree(folder, ignore_errors=True)
        try:
            folder.mkdir(parents=True)
            job.make(folder)
        except EvsError as reason:
            raise EvsError(f"{job.name}: {reason}") from None
        except OSError as reason:
            told = reason.strerror or str(reason)
            where = f": '{reason.filename}'" if reason.filename else ""
            raise EvsError(f"{job.name}: {told}{where}") from None
        except Exception as error:
            error.add_note(f"in job {job.name}")
            raise
        return folder
