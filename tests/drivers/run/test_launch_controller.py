"""The launch file for a controller of one's own, with a camera in lock-step that records."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from evs.drivers import files
from evs.drivers.run.launcher.plan import read_plan
from evs.launch.main import main

pytestmark = pytest.mark.integration

CONTROLLER = """
import sys
import evs

with evs.connect(sys.argv[1]) as loop:
    seen = loop.reset(seed=1)
    events = 0
    while not seen.done:
        x = [packet.events["x"].mean() for packet in seen.packets if len(packet)]
        seen = loop.step([(x[-1] - 64) / 64] if x else None)
        events += sum(map(len, seen.packets))
print(events, seen.t_us, seen.done)
"""


def test_a_program_controls_and_is_recorded(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    program, file = tmp_path / "steer.py", tmp_path / "run.aedat4"
    program.write_text(CONTROLLER)
    words = [f"program:={program}", "seconds:=0.3", "camera:=onboard", f"record:={file}"]
    assert main(["launch", "controller", *words]) == 0
    (line,) = (one for one in capfd.readouterr().out.splitlines() if "[controller]" in one)
    events, t_us = map(int, line.split()[1:3])
    assert t_us == 300_000
    assert "0.3 s are over" in line
    told = json.loads(Path(f"{file}.report.json").read_text())
    assert told["packets"] == 300
    # what the controller saw is what was recorded
    assert len(files.read(file)) == events > 100


@pytest.mark.parametrize("name", ["controller", "cartpole", "goalie", "pencil"])
def test_in_lock_step_whoever_drives_the_world_records(name: str) -> None:
    """A recorder on the bus is not waited for: it lost one packet in seven under load."""
    program = ["program:=steer.py"] if name == "controller" else []
    given = ["record:=run.aedat4", "overwrite:=true", *program]
    nodes = {node.name: node.run for node in read_plan(name, given).nodes}
    assert [run[1] for run in nodes.values()].count("record") == 0
    assert {"record=run.aedat4", "overwrite=true"} <= {*nodes["world"]}


def test_a_program_that_fails_ends_it_all(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "steer.py"
    program.write_text("raise SystemExit('no idea')")
    assert main(["launch", "controller", f"program:={program}"]) == 1
    said = capfd.readouterr()
    assert "[controller] no idea" in said.out + said.err
    assert "launch: controller has ended: stopping every node" in said.err
    assert main(["launch", "controller"]) == 2
    assert "it needs program:=VALUE: a Python program" in capfd.readouterr().err
