"""Jobs on a Ray cluster of two nodes, here: the same bytes."""

from __future__ import annotations

import json
import pickle
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import evs
from evs.tools.jobs import run_jobs
from links.nodes import Nodes, nodes
from reference.worlds_alone import SWING
from speed import jobs

pytestmark = [
    pytest.mark.integration,
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("ray") is None, reason="the extra `cluster` is not installed"),
]

PROGRAM = """
import json, pickle, sys
from importlib.util import find_spec
from pathlib import Path
from evs.drivers.run.stop_signals import stop_signals
from evs.tools.jobs import run_jobs
from evs.msgs import EvsError

todo, threads = pickle.loads(bytes.fromhex(sys.argv[3]))
with stop_signals() as stopped:
    try:
        ran = run_jobs(
            todo,
            Path(sys.argv[1]),
            ray=sys.argv[2],
            threads=threads,
            on_done=lambda job, _: print(job.name, flush=True),
            on_lost=lambda line: print("lost", line, flush=True),
            stopped=lambda: bool(stopped),
        )
    except EvsError as error:
        print("refused", error)
    else:
        print(json.dumps([ran.made, ran.kept, ran.left, list(ran.lost)]))
"""

SIMULATE = """
import hashlib, os, pickle, signal, sys
from importlib.util import find_spec
from pathlib import Path
import numpy as np
import evs
from evs.tools.jobs import cluster_batches

scene, mark, address = sys.argv[1:]

def start(random, data):
    data.qpos[0] = random.uniform(-1, 1)
    if mark and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)

def digest(samples):
    assert all(one["events"].flags.writeable for one in samples)
    made = hashlib.sha256()
    for one in samples:
        made.update(one["events"].tobytes() + one["depth"].tobytes())
    return made.hexdigest()

dataset = evs.SimulatedDataset(
    scene, "left", samples=60, start=start, truth=["depth"], ticks=5,
    sensor=evs.SensorConfig("dvs128", width=24, height=16), limits={"angle": (-9, 9)},
)
order = [*dataset.sampler()]
taken = 0

def batches(count):
    global taken
    for taken in range(1, count + 1):
        yield order[4 * taken - 4 : 4 * taken]

try:
    if address:
        lost = lambda line: print("lost", line)
        found = cluster_batches(dataset, batches(15), address, on_lost=lost)
        print(digest(next(found)))
        # a place for each core, two more, and that which was taken
        print(taken, flush=True)
        for samples in found:
            print(digest(samples), flush=True)
    else:
        for indices in batches(15):
            print(digest(dataset.__getitems__(indices)), flush=True)
except evs.EvsError as error:
    print("refused", error)
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[Nodes]:
    with nodes(2) as two:
        yield two


def driver(
    cluster: Nodes, target: Path, todo: list[Any], threads: int = 0, address: str = ""
) -> subprocess.Popen[str]:
    """A program that has jobs made by the cluster; a process of its own, as Ray never lets go."""
    told = pickle.dumps((todo, threads)).hex()
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", PROGRAM, target, address or cluster.address, told],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=cluster.environment(),
    )


def said(program: subprocess.Popen[str]) -> list[str]:
    """All that it says; nothing but that."""
    out, err = program.communicate(timeout=100)
    assert program.returncode == 0, err
    assert err == ""
    return out.splitlines()


def test_a_cluster_brings_the_bytes_that_one_process_makes(cluster: Nodes, tmp_path: Path) -> None:
    # one is larger than a piece
    todo = [jobs.Noise(0, kib=9000), *map(jobs.Noise, range(1, 6)), jobs.One("a.txt")]
    lines = said(driver(cluster, tmp_path / "far", todo))
    assert json.loads(lines[-1]) == [7, 0, 0, []]
    run_jobs(todo, tmp_path / "here", threads=1)
    assert jobs.digests(tmp_path / "far") == jobs.digests(tmp_path / "here")
    assert len(jobs.digests(tmp_path / "far")) == 19
    assert sorted(path.name for path in (tmp_path / "far").iterdir()) == ["a.txt", "noise"]
    lines = said(driver(cluster, tmp_path / "far", todo, address="auto"))
    assert json.loads(lines[-1]) == [0, 7, 0, []]


def test_errors_and_deaths_are_told_as_here(cluster: Nodes, tmp_path: Path) -> None:
    lines = said(driver(cluster, tmp_path / "a", [jobs.Fails("bad/1", "evs")]))
    assert lines == ["refused bad/1: the lamp is broken; take another"]
    marks = tmp_path / "marks"
    marks.mkdir()
    lines = said(
        driver(
            cluster,
            tmp_path / "b",
            [jobs.Dies("d", str(marks), 1), jobs.Noise(1), jobs.Dies("m", str(marks), 1, "starve")],
        )
    )
    made, kept, left, lost = json.loads(lines[-1])
    assert (made, kept, left) == (3, 0, 0)
    assert sorted(line.partition(" died")[0] for line in lost) == [
        "d: its node or worker",
        "m: its node or worker",
    ]
    assert sorted(jobs.digests(tmp_path / "b/d")) == ["half1", "whole"]


def test_a_stop_brings_home_what_runs(cluster: Nodes, tmp_path: Path) -> None:
    todo = [jobs.Noise(number, seconds=(number > 0) * 0.5) for number in range(30)]
    program = driver(cluster, tmp_path / "far", todo)
    assert program.stdout is not None
    assert program.stdout.readline().startswith("noise/")
    program.send_signal(signal.SIGTERM)
    made, kept, left, lost = json.loads(said(program)[-1])
    assert kept == 0
    assert 1 <= made < 30
    assert left == 30 - made
    assert lost == []
    assert [path.name for path in (tmp_path / "far").iterdir()] == ["noise"]
    assert len(jobs.digests(tmp_path / "far")) == 3 * made


def simulated(cluster: Nodes, *words: str | Path, source: str = SIMULATE) -> list[str]:
    """What a program prints; a process of its own, as Ray never lets go."""
    program = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", source, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=cluster.environment(),
    )
    return said(program)


def test_batches_of_a_data_set_are_the_same_on_a_cluster(cluster: Nodes, tmp_path: Path) -> None:
    scene = tmp_path / "swing.xml"
    scene.write_text(SWING)
    here = simulated(cluster, scene, "", "")
    assert len({*here}) == 15
    first, taken, *rest = simulated(cluster, scene, "", cluster.address)
    assert [first, *rest] == here
    # no more than are wanted soon
    assert int(taken) == 4
    # a worker is killed in its first batch
    lines = simulated(cluster, scene, tmp_path / "mark", cluster.address)
    lost = [line for line in lines if line.startswith("lost")]
    assert lost
    assert all(
        re.fullmatch(r"lost a batch's node or worker died \(\w+\); it is fetched again", line)
        for line in lost
    )
    assert [line for line in lines if len(line) == 64] == here


def test_the_program_of_the_page_runs(cluster: Nodes, tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/howto/clusters.md").read_text()
    _, program = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    scene = tmp_path / "robot.xml"
    scene.write_text(SWING)
    for written, run in (("robot.xml", str(scene)), ("10_000", "18"), ("auto", cluster.address)):
        assert written in program
        program = program.replace(written, run)
    printed = simulated(cluster, source=program)
    assert printed == ["16 (5, 260, 346)", "2 (5, 260, 346)"]


def test_nodes_that_are_not_like_this_machine_are_refused(cluster: Nodes, tmp_path: Path) -> None:
    # the same evs, but for its number; only this node has room for two threads
    package = Path(evs.__file__).parent
    other = tmp_path / "other/evs"
    other.mkdir(parents=True)
    for folder in ("msgs", "emulator", "drivers", "tools", "examples", "launch", "config"):
        (other / folder).symlink_to(package / folder)
    (other / "__init__.pyi").symlink_to(package / "__init__.pyi")
    text = Path(evs.__file__).read_text()
    (other / "__init__.py").write_text(text.replace(evs.__version__, "0.0.9"))
    cluster.add(2, str(other.parent))
    (line,) = said(driver(cluster, tmp_path / "a", [jobs.Noise(1)], threads=2))
    here = re.escape(evs.__version__)
    assert re.fullmatch(
        rf"refused node .* has evs 0\.0\.9 \(here {here}\), sources of evs \w{{12}} "
        r"\(here \w{12}\); install the same on every node",
        line,
    )
    # none at all
    none = tmp_path / "none/evs"
    none.mkdir(parents=True)
    (none / "__init__.py").touch()
    cluster.add(3, str(none.parent))
    (line,) = said(driver(cluster, tmp_path / "b", [jobs.Noise(1)], threads=3))
    assert re.fullmatch(
        r"refused noise/001: a node cannot take the job \(ModuleNotFoundError: No module named "
        rf"'evs\.\w+'\); install evs {here} with the same extras on every node",
        line,
    )
    (line,) = said(driver(cluster, tmp_path / "c", [jobs.Noise(1)], threads=9))
    assert line.startswith("refused no node of the cluster has 9 CPUs")
