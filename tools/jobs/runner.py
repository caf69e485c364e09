"""run_jobs: run a set of jobs into a folder, each completely or not at all, and none twice."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TypeVar

from evs.msgs import EvsError
from evs.tools.jobs.job import Job, JobMaker, JobSummary, check_names
from evs.tools.jobs.target_folder import TargetFolder
from evs.tools.jobs.worker_pool import MOST_WORKERS, run_units

JobT = TypeVar("JobT", bound=Job)


def run_jobs(
    jobs: Sequence[JobT],
    target: Path,
    *,
    workers: int = 1,
    ray: str = "",
    threads: int = 0,
    on_done: Callable[[JobT, bool], None] = lambda _job, _is_new: None,
    on_share: Callable[[JobT, float], None] = lambda _job, _share: None,
    on_lost: Callable[[str], None] = warnings.warn,
    stopped: Callable[[], bool] = lambda: False,
    then: Callable[[JobT], Iterable[JobT]] = lambda _job: (),
) -> JobSummary:
    """Run the jobs whose `target/name` does not exist. The bytes do not depend on the workers.

    Args:
        jobs: the jobs.
        target: folder for their files.
        workers: processes that run jobs at once; 1: this process.
        ray: address of a Ray cluster that runs them instead.
        threads: threads of each job; 0: its share of the cores, on a cluster one.
        on_done: called with each finished job and whether it is new.
        on_share: called with the progress of a running job, 0 ... 1; not on a cluster.
        on_lost: called with a line when a worker or node dies and its job runs again.
        stopped: polled before each job; running jobs are completed.
        then: returns the jobs that can run once this one is done; they run before the others.

    Returns:
        The numbers of jobs that ran, existed or were left.

    Raises:
        EvsError: a job failed; the message names it. Results of finished jobs remain.
    """
    check_workers(workers, ray)
    check_names(job.name for job in jobs)
    destination = TargetFolder(target)
    lost: list[str] = []

    def report_lost(line: str) -> None:
        lost.append(line)
        on_lost(line)

    todo: list[JobT] = []
    every, made, kept = list(jobs), 0, 0

    def ready(job: JobT) -> Iterable[JobT]:
        """The jobs that can run now that this one is done, with new names."""
        found = list(then(job))
        if found:
            every.extend(found)
            check_names(each.name for each in every)
        return found

    def missing_of(waiting: Iterable[JobT]) -> list[JobT]:
        """Those of them, and of the jobs that follow them, that have no result yet."""
        nonlocal kept
        rest, missing = list(waiting), []
        while rest:
            job = rest.pop(0)
            if destination.has(job.name):
                on_done(job, False)
                kept += 1
                rest[:0] = ready(job)
            else:
                missing.append(job)
        return missing

    def run_in(staging: Path) -> Generator[tuple[JobT, Path], None, None]:
        """Run the jobs; yield each with its folder."""
        if ray:
            # imported here, because Ray is optional
            from evs.tools.jobs.ray_cluster import run_on_cluster

            return run_on_cluster(
                todo, ray, staging, threads=threads, stopped=stopped, on_lost=report_lost
            )
        return run_units(
            todo,
            JobMaker(staging),
            workers,
            threads=threads,
            stopped=stopped,
            on_lost=report_lost,
            on_share=on_share,
        )

    todo += missing_of(jobs)
    if todo:
        # closed at once if on_done raises, so that no worker writes into a removed folder
        with destination.staging() as staging, closing(run_in(staging)) as done:
            for job, folder in done:
                destination.store(job.name, folder)
                shutil.rmtree(folder, ignore_errors=True)
                made += 1
                on_done(job, True)
                todo[:0] = missing_of(ready(job))
    return JobSummary(made, kept, len(every) - made - kept, tuple(lost))


def check_workers(workers: int, ray: str) -> None:
    """Check the options of run_jobs.

    Raises:
        EvsError: the options conflict or are out of range.
    """
    if not 1 <= workers <= MOST_WORKERS:
        raise EvsError(f"workers is {workers}: give 1 ... {MOST_WORKERS}")
    if ray and workers != 1:
        raise EvsError("a Ray cluster has workers of its own; give --workers or --ray, not both")
