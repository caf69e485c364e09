"""The runner on one machine: whole or not at all, none twice, and workers may die."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from evs.drivers.clock import monotonic_s
from evs.drivers.search_path import search_path
from evs.msgs import EvsError
from evs.tools.jobs import JobSummary, run_jobs, run_units
from evs.tools.jobs.target_folder import PREFIX
from speed import jobs


@pytest.mark.integration
def test_any_number_of_workers_brings_the_same_files(tmp_path: Path) -> None:
    todo = [jobs.Noise(number, kib=40) for number in range(5)]
    assert run_jobs(todo, tmp_path / "one") == JobSummary(5, 0, 0)
    assert run_jobs(todo, tmp_path / "two", workers=2) == JobSummary(5, 0, 0)
    found = jobs.digests(tmp_path / "one")
    assert len(found) == 15
    assert found["noise/004/in/b.txt"] == hashlib.sha256(b"4\n").hexdigest()
    assert jobs.digests(tmp_path / "two") == found
    # nothing else is left in either
    assert [path.name for path in (tmp_path / "two").iterdir()] == ["noise"]


def test_what_is_there_is_kept_and_the_rest_is_made(tmp_path: Path) -> None:
    todo = [jobs.Noise(number) for number in range(4)]
    (tmp_path / "noise/002").mkdir(parents=True)
    (tmp_path / "noise/002/mine").touch()
    said: list[tuple[str, bool]] = []
    ran = run_jobs(todo, tmp_path, on_done=lambda job, is_new: said.append((job.name, is_new)))
    assert ran == JobSummary(3, 1, 0)
    assert said == [
        ("noise/002", False),
        ("noise/000", True),
        ("noise/001", True),
        ("noise/003", True),
    ]
    assert [path.name for path in (tmp_path / "noise/002").iterdir()] == ["mine"]
    assert run_jobs(todo, tmp_path) == JobSummary(0, 4, 0)


@pytest.mark.integration
@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_follows_another_is_made_once_that_one_is_there(
    tmp_path: Path, workers: int
) -> None:
    """A chain, of which two links are there already, beside jobs that wait for nothing."""

    def then(job: jobs.Noise) -> list[jobs.Noise]:
        assert (tmp_path / job.name).is_dir()
        return [jobs.Noise(job.number + 1)] if job.number < 4 else []

    run_jobs([jobs.Noise(0), jobs.Noise(1)], tmp_path)
    said: list[str] = []
    ran = run_jobs(
        [jobs.Noise(0), jobs.Noise(7)],
        tmp_path,
        workers=workers,
        on_done=lambda job, is_new: said.append(job.name),
        then=then,
    )
    assert ran == JobSummary(4, 2, 0)
    assert sorted(said) == [f"noise/{number:03d}" for number in (0, 1, 2, 3, 4, 7)]
    if workers == 1:
        # what others wait for goes first
        assert said[-1] == "noise/007"


def test_a_file_of_the_jobs_name_arrives_itself(tmp_path: Path) -> None:
    shares: list[tuple[str, float]] = []
    todo = [jobs.One("00001.npz")]
    run_jobs(todo, tmp_path, on_share=lambda job, share: shares.append((job.name, share)))
    assert (tmp_path / "00001.npz").read_text() == "0"
    assert shares == [("00001.npz", 0.5)]


@pytest.mark.integration
def test_workers_share_the_cores_and_tell_how_far_they_are(tmp_path: Path) -> None:
    shares: list[tuple[str, float]] = []
    todo = [jobs.One("a"), jobs.One("b")]
    run_jobs(
        todo, tmp_path, workers=2, on_share=lambda job, share: shares.append((job.name, share))
    )
    each = max(1, len(os.sched_getaffinity(0)) // 2)
    assert [(tmp_path / name).read_text() for name in "ab"] == [str(each)] * 2
    assert sorted(shares) == [("a", 0.5), ("b", 0.5)]
    run_jobs([jobs.One("c")], tmp_path, workers=2, threads=5)
    assert (tmp_path / "c").read_text() == "5"


@pytest.mark.integration
@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("kill", "SIGKILL; out of memory?"),
        pytest.param("starve", "no memory", marks=pytest.mark.slow),
        pytest.param("exit", "exit code 7", marks=pytest.mark.slow),
    ],
)
def test_a_worker_that_dies_is_told_and_its_job_made_by_another(
    tmp_path: Path, how: str, says: str
) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    told: list[str] = []
    todo = [jobs.Dies("d", str(marks), 2, how), jobs.Noise(1), jobs.Noise(2)]
    ran = run_jobs(todo, tmp_path / "out", workers=2, on_lost=told.append)
    assert (ran.made, ran.kept, ran.left) == (3, 0, 0)
    assert list(ran.lost) == told
    assert len(told) == 2
    assert all(line.startswith("d: its worker died") and says in line for line in told)
    # each time in another process, and nothing of the halves is there
    pids = {path.name.split("-")[2] for path in marks.iterdir()}
    assert len(pids) == 3
    assert sorted(jobs.digests(tmp_path / "out/d")) == ["half2", "whole"]


@pytest.mark.integration
def test_a_job_that_always_kills_its_worker_is_given_up(tmp_path: Path) -> None:
    todo = [jobs.Dies("d", str(tmp_path), 99), *map(jobs.Noise, range(3))]
    with (
        pytest.warns(UserWarning, match="d: its worker died"),
        pytest.raises(EvsError, match=r"d: its worker died 3 times .*fewer --workers"),
    ):
        run_jobs(todo, tmp_path / "out", workers=2)
    # what ran beside it came home, and the rest goes on later
    assert not (tmp_path / "out/d").exists()
    ran = run_jobs(todo[1:], tmp_path / "out")
    assert ran.made + ran.kept == 3
    assert ran.kept >= 1


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("kind", "error", "says"),
    [
        ("evs", EvsError, "bad/1: the lamp is broken; take another"),
        ("disk", EvsError, "bad/1: No space left on device"),
        ("missing", EvsError, "bad/1: No such file or directory: '.*none/x'"),
        ("other", ZeroDivisionError, "by nothing"),
    ],
)
def test_a_job_that_raises_is_named(
    tmp_path: Path, workers: int, kind: str, error: type[Exception], says: str
) -> None:
    todo = [jobs.Noise(0), jobs.Fails("bad/1", kind), jobs.Noise(1)]
    with pytest.raises(error, match=says) as caught:
        run_jobs(todo, tmp_path, workers=workers)
    if kind == "other":
        assert "in job bad/1" in "".join(caught.value.__notes__)
    # nothing half is left, and what was made before is whole
    assert [path.name for path in tmp_path.iterdir()] == ["noise"]
    assert run_jobs([jobs.Noise(0)], tmp_path) == JobSummary(0, 1, 0)


def test_an_exception_that_cannot_be_carried_is_told_all_the_same(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="OddError: 1 and 2") as caught:
        run_jobs([jobs.Fails("f", "odd")], tmp_path, workers=2)
    assert "in make" in "".join(caught.value.__notes__)


@pytest.mark.integration
@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_without_files_is_no_job(tmp_path: Path, workers: int) -> None:
    with pytest.raises(EvsError, match="e: it has written nothing"):
        run_jobs([jobs.Empty("e")], tmp_path, workers=workers)
    with pytest.raises(EvsError, match="wrote link, which is not a file"):
        run_jobs([jobs.Link("l")], tmp_path, workers=workers)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.integration
def test_a_warning_of_a_worker_is_one_of_this_process(tmp_path: Path) -> None:
    with pytest.warns(RuntimeWarning, match="the light is dim"):
        run_jobs([jobs.Warns("w")], tmp_path, workers=2)


@pytest.mark.integration
@pytest.mark.parametrize("workers", [1, 2])
def test_a_stop_brings_home_what_runs(tmp_path: Path, workers: int) -> None:
    todo = [jobs.Noise(number) for number in range(6)]
    done: list[str] = []
    ran = run_jobs(
        todo,
        tmp_path,
        workers=workers,
        on_done=lambda job, _: done.append(job.name),
        stopped=lambda: bool(done),
    )
    assert ran.left > 0
    assert ran.made == len(done) == 6 - ran.left
    assert sorted(f"noise/{path.name}" for path in (tmp_path / "noise").iterdir()) == sorted(done)
    assert run_jobs(todo, tmp_path) == JobSummary(ran.left, ran.made, 0)


@pytest.mark.integration
def test_on_done_may_end_it(tmp_path: Path) -> None:
    class EnoughError(Exception):
        pass

    def enough(job: jobs.Noise, is_new: bool) -> None:
        raise EnoughError

    todo = [jobs.Noise(number, seconds=0.0 if number == 0 else 60.0) for number in range(3)]
    began_s = monotonic_s()
    with pytest.raises(EnoughError):
        run_jobs(todo, tmp_path, workers=2, on_done=enough)
    assert monotonic_s() - began_s < 30.0
    assert sorted(path.name for path in tmp_path.rglob("*")) == [
        *("000", "a.bin", "b.txt", "empty", "in", "noise")
    ]


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["a", "a"], "'a' is there twice"),
        (["a", "a/b"], "'a/b' lies inside job 'a'"),
        (["../a"], "below the target"),
        (["/a"], "below the target"),
        (["a//b"], "below the target"),
        ([".hidden"], "below the target"),
        ([""], "below the target"),
    ],
)
def test_names_that_cannot_be(tmp_path: Path, names: list[str], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        run_jobs([jobs.One(name) for name in names], tmp_path)


def test_a_target_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(EvsError, match="cannot write to"):
        run_jobs([jobs.One("a")], tmp_path / "file")
    with pytest.raises(EvsError, match="workers is 0: give"):
        run_jobs([jobs.One("a")], tmp_path, workers=0)


def test_what_a_killed_run_left_goes_and_what_another_one_makes_stays(tmp_path: Path) -> None:
    left = tmp_path / f"{PREFIX}left"
    (left / "x").mkdir(parents=True)

    @dataclass(frozen=True)
    class Beside:
        name: str = "outer"

        def make(self, folder: Path) -> None:
            # a second run, in the middle of this one
            assert run_jobs([jobs.One("inner")], tmp_path) == JobSummary(1, 0, 0)
            (folder / "x").touch()

    assert run_jobs([Beside()], tmp_path) == JobSummary(1, 0, 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["inner", "outer"]


def test_who_comes_second_gives_way(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Late:
        name: str = "noise/001"

        def make(self, folder: Path) -> None:
            run_jobs([jobs.Noise(1)], tmp_path)
            (folder / "late").touch()

    assert run_jobs([Late()], tmp_path) == JobSummary(1, 0, 0)
    assert sorted(jobs.digests(tmp_path)) == [
        f"noise/001/{n}" for n in ("a.bin", "empty", "in/b.txt")
    ]


@pytest.mark.integration
@pytest.mark.parametrize("workers", [1, 2])
def test_work_may_make_more_work(workers: int) -> None:
    todo, values = [1, 2], {}
    for unit, value in run_units(todo, str, workers):
        values[unit] = int(value)
        if unit < 10:
            todo.append(10 * unit)
    assert list(values) == [1, 2, 10, 20] if workers == 1 else set(values) == {1, 2, 10, 20}


@pytest.mark.slow
def test_the_program_of_the_page_runs(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/howto/clusters.md").read_text()
    # test_jobs_cluster.py runs the other
    program, _ = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    program = program.replace("...   ", '(folder / "film").write_text(str(job_threads()))   ')
    (tmp_path / "films.py").write_text(program.replace("range(100)", "range(9)"))
    environment = dict(os.environ, PYTHONPATH=search_path())
    subprocess.run([sys.executable, "films.py"], cwd=tmp_path, check=True, env=environment)
    assert sorted(path.name for path in (tmp_path / "out/street").iterdir()) == [
        f"{seed:04d}" for seed in range(9)
    ]
    each = max(1, len(os.sched_getaffinity(0)) // 4)
    assert (tmp_path / "out/street/0007/film").read_text() == str(each)
