"""run_jobs: bring a set of jobs to a folder, each whole or not at all, and none twice."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TypeVar

from evs.msgs import EvsError
from evs.tools.jobs.job import Job, Ran, check_names
from evs.tools.jobs.make import MakeIn
from evs.tools.jobs.target import Target
from evs.tools.jobs.work import MOST_WORKERS, work_off

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
) -> Ran:
    """Make the jobs whose `target/name` is not there yet. The same bytes, whoever makes them.

    In: workers, processes that work at once, 1: this one does; ray, address of a Ray cluster that
    does it instead; threads, of each job, 0: its share of the cores, one on a cluster; on_done,
    told each job when it is there, and whether it is new; on_share, told how far a running job is,
    0 ... 1 (a cluster does not tell); on_lost, told a line when a worker or a node dies and its job
    is made elsewhere; stopped, asked before each job: those that run are still brought home; then,
    the jobs that can be made now that this one is there, which go before others.
    Raises EvsError, which names the job; the jobs that arrived before stay.
    """
    check_workers(workers, ray)
    check_names(job.name for job in jobs)
    goal = Target(target)
    lost: list[str] = []

    def tell_lost(line: str) -> None:
        lost.append(line)
        on_lost(line)

    todo: list[JobT] = []
    known, made, kept = list(jobs), 0, 0

    def ready(job: JobT) -> Iterable[JobT]:
        """The jobs that follow one which is there, none of them known before."""
        found = list(then(job))
        if found:
            known.extend(found)
            check_names(each.name for each in known)
        return found

    def todo_of(waiting: Iterable[JobT]) -> list[JobT]:
        """Those of them, and of what follows them, that are not there."""
        nonlocal kept
        rest, missing = list(waiting), []
        while rest:
            job = rest.pop(0)
            if goal.has(job.name):
                on_done(job, False)
                kept += 1
                rest[:0] = ready(job)
            else:
                missing.append(job)
        return missing

    def made_in(making: Path) -> Generator[tuple[JobT, Path], None, None]:
        """Each job with the folder in which it was made."""
        if ray:
            # here, so that who needs no cluster imports none of it
            from evs.tools.jobs.cluster import work_far

            return work_far(todo, ray, making, threads=threads, stopped=stopped, on_lost=tell_lost)
        return work_off(
            todo,
            MakeIn(making),
            workers,
            threads=threads,
            stopped=stopped,
            on_lost=tell_lost,
            on_share=on_share,
        )

    todo += todo_of(jobs)
    if todo:
        # closed at once where on_done raises: no worker writes into what is removed
        with goal.making() as making, closing(made_in(making)) as done:
            for job, folder in done:
                goal.arrive(job.name, folder)
                shutil.rmtree(folder, ignore_errors=True)
                made += 1
                on_done(job, True)
                todo[:0] = todo_of(ready(job))
    return Ran(made, kept, len(known) - made - kept, tuple(lost))


def check_workers(workers: int, ray: str) -> None:
    """EvsError where run_jobs could not begin with these."""
    if not 1 <= workers <= MOST_WORKERS:
        raise EvsError(f"{workers} workers cannot be: give 1 ... {MOST_WORKERS}")
    if ray and workers != 1:
        raise EvsError("a Ray cluster has workers of its own; give --workers or --ray, not both")
