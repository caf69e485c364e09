"""What lies in the working directory or stands in MUJOCO_GL does not keep evs from starting."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.extremes

MODEL = "<mujoco><worldbody><light/><geom size='.1'/></worldbody></mujoco>"
CHECKOUT = Path(__file__).parents[3]
EVS = Path(sys.executable).with_name("evs")


def run(folder: Path, *command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    surroundings = {**os.environ, **variables}
    return subprocess.run(
        command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=60
    )


@pytest.mark.parametrize("who", ["program", "library"])
def test_a_module_in_the_working_directory_is_not_run(tmp_path: Path, who: str) -> None:
    """glfw's helper imported it, whenever MuJoCo was imported."""
    for name in ("ctypes", "sys", "struct", "subprocess"):
        text = f"import os; os.mkdir({str(tmp_path / 'was run')!r})"
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "robot.xml").write_text(MODEL)
    library = "import os; import evs; evs.World; assert 'PYTHONSAFEPATH' not in os.environ"
    command = {
        "program": (str(EVS), "plan", "robot.xml"),
        "library": (sys.executable, "-P", "-c", library),
    }[who]
    done = run(tmp_path, *command)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "was run").exists()


@pytest.mark.parametrize("order", ["import mujoco, evs; evs.World", "import evs; evs.World"])
def test_mujoco_gl_egl_as_on_every_gpu_workstation(tmp_path: Path, order: str) -> None:
    """With the extra `raster` beside it: its PyOpenGL has to be one that MuJoCo takes."""
    line = f"{order}; import mujoco; print(mujoco.GLContext.__module__.split('.')[0])"
    done = run(tmp_path, sys.executable, "-W", "error", "-c", line, MUJOCO_GL="egl")
    assert (done.stdout, done.stderr, done.returncode) == ("mujoco\n", "", 0)


def test_a_mujoco_gl_that_does_not_load_is_named(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(MODEL)
    done = run(tmp_path, str(EVS), "plan", "robot.xml", MUJOCO_GL="elg")
    assert done.returncode == 2
    assert "with MUJOCO_GL=elg" in done.stderr
    assert "unset MUJOCO_GL" in done.stderr
    assert done.stderr.count("\n") == 1


def test_programs_of_ours_have_a_safe_path() -> None:
    """With -m and -c, Python looks for modules in the working directory first."""
    for folder in ("emulator", "drivers", "launch"):
        for file in sorted(Path(CHECKOUT, folder).rglob("*.py")):
            for option in re.findall(r'sys\.executable, "(-\w+)"', file.read_text()):
                assert option == "-P", file
