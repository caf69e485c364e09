"""Errors of a sweep on a Ray cluster: the records that one process makes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from evs.launch.main import main
from evs.tools.sweep.store import read_sweep
from links.nodes import nodes
from reference.judged import written

pytest.importorskip("ray")
pytestmark = [pytest.mark.integration, pytest.mark.slow]


def test_a_cluster_gives_the_errors_that_one_process_gives(tmp_path: Path) -> None:
    line = ["sweep", str(written(tmp_path)), "--preset", "fast", "--axis", "tick", "--errors-only",
            "--pixels", "40", "--ticks", "30", "--reference-spp", "16", "--quiet"]  # fmt: skip

    def kept(name: str) -> list[str]:
        return ["--cache", str(tmp_path / name), "--json", str(tmp_path / f"{name}.jsonl")]

    with nodes(1) as cluster:
        ended = subprocess.run(
            [sys.executable, "-m", "evs.launch.main", *line, *kept("far"), "--ray",
             cluster.address],
            env=cluster.environment(), capture_output=True, text=True, timeout=100, check=False,
        )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    assert main([*line, *kept("here")]) == 0
    here, far = ({one.point: one for one in read_sweep(tmp_path / f"{name}.jsonl")[1]}
                 for name in ("here", "far"))  # fmt: skip
    assert here == far
    assert len(here) == 12
