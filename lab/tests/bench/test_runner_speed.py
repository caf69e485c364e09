"""The runner from one worker to two, on scenes of training data, beside bare loops and pools."""

from __future__ import annotations

import multiprocessing
import tempfile
from pathlib import Path

import pytest

from evs.tools.jobs import JobSummary, run_jobs
from evs_lab.training.make import ShardJob
from speed.scene_alone import SCENE, scene_alone
from speed.turns import Table, milliseconds

SCENES = 8
LOOP, POOL = "a bare loop", "multiprocessing.Pool(2)"


def bare() -> None:
    for number in range(SCENES):
        scene_alone(number)


def pool() -> None:
    """Started anew each time, as the runner's workers are; it keeps nothing."""
    with multiprocessing.get_context("spawn").Pool(2) as two:
        two.map(scene_alone, range(SCENES), chunksize=1)


def run(workers: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        todo = [ShardJob(SCENE, number) for number in range(SCENES)]
        ran = run_jobs(todo, Path(folder), workers=workers, threads=1)
        assert ran == JobSummary(SCENES, 0, 0)


@pytest.mark.bench
def test_scenes_on_one_worker_and_on_two() -> None:
    one, two = "run_jobs, 1 worker", "run_jobs, 2 workers"
    calls = {LOOP: bare, POOL: pool, one: lambda: run(1), two: lambda: run(2)}
    times = milliseconds(calls, 5)
    title = f"{SCENES} training scenes, one thread each; starts, files and checks included"
    print(Table(title, {"ms": times}, {one: LOOP, two: POOL}))
    print(f"2 workers are {times[one].median / times[two].median:.2f} times as fast as 1;", end=" ")
    print(f"a bare pool of 2 is {times[LOOP].median / times[POOL].median:.2f} times a bare loop")
    assert all(time.median > 0 for time in times.values())
