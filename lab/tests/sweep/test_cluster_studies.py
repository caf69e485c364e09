"""Errors of a sweep and training data on a Ray cluster: those that one process makes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from evs.launch.main import main
from evs_lab.sweep.store import read_sweep
from links.nodes import Nodes, nodes
from reference.judged import written

pytest.importorskip("ray")
pytestmark = [pytest.mark.integration, pytest.mark.slow]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Nodes]:
    with nodes(1) as one:
        yield one


def printed(cluster: Nodes, *words: str) -> str:
    """What a command prints that runs on the cluster."""
    ended = subprocess.run(
        [sys.executable, "-m", "evs.launch.main", *words, "--ray", cluster.address],
        env=cluster.environment(), capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    return ended.stdout


def test_a_cluster_gives_the_errors_that_one_process_gives(cluster: Nodes, tmp_path: Path) -> None:
    line = ["sweep", str(written(tmp_path)), "--preset", "fast", "--axis", "tick", "--errors-only",
            "--pixels", "40", "--ticks", "30", "--reference-spp", "16", "--quiet"]  # fmt: skip

    def kept(name: str) -> list[str]:
        return ["--cache", str(tmp_path / name), "--json", str(tmp_path / f"{name}.jsonl")]

    printed(cluster, *line, *kept("far"))
    assert main([*line, *kept("here")]) == 0
    here, far = ({one.point: one for one in read_sweep(tmp_path / f"{name}.jsonl")[1]}
                 for name in ("here", "far"))  # fmt: skip
    assert here == far
    assert len(here) == 12


def test_training_data_is_the_same_on_a_cluster(cluster: Nodes, tmp_path: Path) -> None:
    words = ["--scenes", "3", "--pixels", "8", "--ticks", "12", "--truth-spp", "16"]
    far, here = tmp_path / "far", tmp_path / "here"
    assert printed(cluster, "train", "data", str(far), *words) == (
        f"{far}: 3 scenes made, 0 were there\n"
    )
    assert main(["train", "data", str(here), "--quiet", *words]) == 0
    contents = [{p.name: p.read_bytes() for p in folder.iterdir()} for folder in (far, here)]
    assert contents[0] == contents[1]
    assert len(contents[0]) == 4
