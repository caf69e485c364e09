"""A data set on a Ray cluster of two nodes, of which one is killed midway: the same bytes."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from evs.launch.main import main
from evs.tools.dataset.manifest import MANIFEST, listed
from links.nodes import nodes

pytestmark = [
    pytest.mark.integration,
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("ray") is None, reason="the extra `cluster` is not installed"),
]

WORDS = ["--short", "--scenes", "park,workshop", "--duration", "0.15", "sensor.width=43"]


def made_while_a_node_is_killed(far: Path) -> str:
    """Make the data set on two nodes, of which one is killed at work. Returns what it warns of."""
    with nodes(2) as cluster:
        program = subprocess.Popen(
            [sys.executable, "-m", "evs.launch.main", "dataset", far]
            + [*WORDS, "--ray", cluster.address],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=cluster.environment(),
        )
        until_s = time.monotonic() + 60
        while len(list(far.glob("[!.]*/*/0*"))) < 3 or not cluster.kill_at_work(1):
            assert time.monotonic() < until_s
            time.sleep(0.02)
        assert not (far / MANIFEST).exists()
        out, err = program.communicate(timeout=100)
    assert program.returncode == 0, err
    # two scenes of three ranges, events and frames
    assert out == f"{far}: 12 shards made, 0 were there\n"
    return err


def test_a_data_set_completes_where_a_node_is_killed_midway(tmp_path: Path) -> None:
    here = tmp_path / "here"
    # a worker that is named after its shard may have delivered it already: then none was lost
    for attempt in range(3):
        far = tmp_path / f"far{attempt}"
        warned = made_while_a_node_is_killed(far)
        if warned:
            break
    assert re.fullmatch(
        r"(evs: warning: (park|workshop)/\w+/000\d: its node or worker died \(\w+\); "
        r"it is made again\n)+",
        warned,
    )
    assert main(["dataset", str(here), "--quiet", *WORDS]) == 0
    assert listed(far) == listed(here)
    assert (far / MANIFEST).read_bytes() == (here / MANIFEST).read_bytes()
    assert main(["dataset", str(far), "--verify", "--quiet"]) == 0
