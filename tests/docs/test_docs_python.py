"""Every Python program of the pages runs, with a small robot and short durations."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import pytest

import evs
from evs.drivers.bus.address import free_address
from evs.launch.main import main

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "lab/docs").rglob("*.md")]
)

ROBOT = """
<mujoco model="robot">
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <geom type="plane" size="5 5 .1" rgba=".4 .5 .6 1"/>
    <camera name="left" pos="-.1 -2 1" xyaxes="1 0 0 0 .3 1"/>
    <camera name="right" pos=".1 -2 1" xyaxes="1 0 0 0 .3 1"/>
    <body name="arm" pos="0 0 1">
      <joint name="hinge" type="hinge" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .4 0 0" rgba=".9 .2 .1 1"/>
      <body name="hand" pos=".4 0 0">
        <geom type="box" size=".05 .05 .05" mass=".1"/>
        <camera name="wrist" pos="0 0 .1"/>
        <site name="tip" pos=".05 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge" gear="1" ctrlrange="-1 1"/></actuator>
  <sensor>
    <jointpos name="tilt" joint="hinge"/>
    <framepos name="distance" objtype="site" objname="tip"/>
  </sensor>
  <keyframe><key name="leaning" qpos=".1" ctrl="0"/></keyframe>
</mujoco>
"""

# page -> why its programs are not run here
ELSEWHERE = {
    "docs/howto/controller_tests.md": "run by tests/tools/testing/test_testing_plugin.py",
    "docs/howto/clusters.md": "run by tests/tools/jobs/test_jobs_processes.py",
    "docs/howto/datasets.md": "needs a data set; tests/tools/dataset has them",
    "docs/howto/dv.md": "needs a camera that serves DV; tests/drivers/dv has them",
    "docs/howto/install.md": "run by tests/drivers/bus/test_bus_other_language.py",
    "docs/howto/learners.md": "needs PyTorch: sh .ci/learners.sh",
    "docs/howto/environments.md": "needs other environments: sh .ci/versions.sh",
}

# what shortens the programs: (as the page has it, as it is run)
SHORTER = [
    ("while data.time < 1:", "while data.time < 0.01:"),
    ("max_s=10.0", "max_s=0.05"),
    ("max_s=30.0", "max_s=0.05"),
    ("world.run(0.1)", "world.run(0.005)"),
    ("timeout_s=2", "timeout_s=0.2"),
]


def programs_of(page: Path) -> list[str]:
    """The Python blocks of a page."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def name_of(page: Path) -> str:
    """From the top of the checkout."""
    return str(page.relative_to(ROOT))


WITH = [page for page in PAGES if programs_of(page)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot, into which the programs write."""
    (tmp_path / "robot.xml").write_text(ROBOT)
    (tmp_path / "config").symlink_to(ROOT / "config")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def record(*more: str) -> None:
    """A short recording of the robot in the working directory, run.aedat4."""
    small = ["sensor.width=32", "sensor.height=24", "render.spp=1", "--quiet"]
    words = ["emulate", "robot.xml", "--duration", "0.02", "scene.control=random", *small]
    assert main([*words, "--record", "run.aedat4", *more]) == 0


def names_before() -> dict[str, Any]:
    """What a reader has at hand before a page's first program."""
    model = mujoco.MjModel.from_xml_path("robot.xml")
    return {
        "evs": evs,
        "model": model,
        "data": mujoco.MjData(model),
        "scene": "robot.xml",
        "controller": lambda seen: [0.0],
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in WITH if name_of(page) not in ELSEWHERE], ids=name_of
)
def test_the_programs_of_a_page_run(page: Path, folder: Path) -> None:
    if "run.aedat4" in "".join(programs_of(page)):
        record()
    names = names_before()
    for number, program in enumerate(programs_of(page)):
        if 'evs.connect("tcp' in program:
            # run by tests/drivers/lockstep/test_lockstep_readme.py, which has a server
            continue
        for written, run in SHORTER:
            program = program.replace(written, run)
        # nobody publishes there
        program = program.replace("tcp://127.0.0.1:5560", free_address())
        exec(compile(program, f"{name_of(page)}, block {number}", "exec"), names)  # noqa: S102


def test_those_that_are_not_run_are_pages_with_programs() -> None:
    assert set(ELSEWHERE) <= {name_of(page) for page in WITH}


def test_the_recording_tutorial_works_from_top_to_bottom(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "docs/tutorials/recording.md").read_text()
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    lines = [line.split("#")[0].split() for block in blocks for line in block.splitlines()]
    ran = 0
    for words in lines:
        if "tcp://127.0.0.1:5560" in words:
            # needs a camera that publishes; tests/drivers/run/test_record_live.py has one
            continue
        if words[1] == "emulate":
            words += ["duration_s=0.05" if "--duration" not in words else "seed=0"]
            words = [word if word != "2" else "0.05" for word in words]
            words += ["sensor.width=32", "sensor.height=24", "render.spp=1", "scene.control=random"]
        assert main(words[1:]) == 0, (words, capsys.readouterr().err)
        ran += 1
    assert ran >= 8
    assert {path.name for path in folder.iterdir()} >= {
        *("run.aedat4", "run.aedat4.png", "run.gif", "run.csv", "run.raw", "both.aedat4"),
        "long.aedat4",
    }
