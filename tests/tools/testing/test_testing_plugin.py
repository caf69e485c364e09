"""The pytest plugin as its users have it: pytest in a process of its own, the page's example."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import evs

PLUGIN = "evs.tools.testing.plugin"
PAGE = Path(__file__).parents[3] / "docs/howto/controller_tests.md"


def environment(*folders: Path) -> dict[str, str]:
    """Where the evs of this process is found from any folder, and what lies in `folders`."""
    found = [str(folder) for folder in folders] + [str(Path(evs.__file__).parents[1])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(found)}


def run_pytest(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """pytest in `folder`; `arguments` load the plugin, or do not."""
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments],
        cwd=folder,
        # what else is installed here has nothing to do with it, and is slow to load
        env={**environment(), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def example() -> str:
    """The program in the page."""
    (program,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    return str(program)


@pytest.mark.slow
def test_the_example_of_the_page_works_as_written(tmp_path: Path) -> None:
    # but for its timing: no machine is slow enough for this
    patient = example().replace("median_us=2000, p99_us=20000", "median_us=1e9, p99_us=1e9")
    assert patient != example()
    (tmp_path / "test_balance.py").write_text(patient)
    ran = run_pytest(tmp_path, "-p", "evs", "-W", "error")
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


@pytest.mark.slow
def test_the_example_can_fail_and_says_what_an_engineer_needs(tmp_path: Path) -> None:
    # the same controller with its sign turned pushes the pole over
    wrong = example().replace("12.0 * self.lean", "-12.0 * self.lean")
    assert wrong != example()
    (tmp_path / "test_balance.py").write_text(wrong)
    ran = run_pytest(tmp_path, "-p", PLUGIN, f"--basetemp={tmp_path / 'kept'}")
    assert "1 failed" in ran.stdout
    assert re.search(
        r"an episode ends before its time: seed \d ends at t = 0\.\d+ s of 2 s: angle left",
        ran.stdout,
    ), ran.stdout
    assert "3 of 3 seeds fail: 0, 1, 2" in ran.stdout
    # the traceback ends in the test and not in our code
    assert "tools/testing/run.py" not in ran.stdout
    (program,) = set(re.findall(r"run it again: (from .*)$", ran.stdout, re.MULTILINE))
    again = subprocess.run(
        [sys.executable, "-c", program.replace("list(", "print(len(list(").rstrip() + "))"],
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert int(again.stdout) > 50, again.stderr
    (look,) = set(re.findall(r"look: evs (view .*)$", ran.stdout, re.MULTILINE))
    viewed = subprocess.run(
        [sys.executable, "-m", "evs.launch.main", *look.split()],
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert viewed.returncode == 0, viewed.stderr
    assert list((tmp_path / "kept").rglob("*.gif"))


def test_who_does_not_ask_for_the_fixture_pays_nothing(tmp_path: Path) -> None:
    (tmp_path / "test_other.py").write_text(
        "import sys\n"
        "def test_nothing_of_it_is_here(request):\n"
        "    heavy = {'numpy', 'mujoco', 'zmq', 'msgpack', 'evs.msgs', 'evs.emulator'}\n"
        "    assert not heavy & set(sys.modules)\n"
        f"    assert '{PLUGIN}' in sys.modules\n"
    )
    ran = run_pytest(tmp_path, "-p", PLUGIN, "-W", "error")
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


def test_an_installed_evs_is_loaded_by_no_test_run_that_does_not_ask(tmp_path: Path) -> None:
    project = tomllib.loads((PAGE.parents[2] / "pyproject.toml").read_text())["project"]
    assert "entry-points" not in project
    (tmp_path / "test_other.py").write_text(
        "import sys\n"
        "def test_nothing_of_it_is_here():\n"
        "    assert not [name for name in sys.modules if name.startswith('evs')]\n"
    )
    ran = run_pytest(tmp_path)
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


@pytest.mark.integration
@pytest.mark.parametrize(
    ("arguments", "conftest"),
    [
        (["-p", "evs"], ""),
        pytest.param(["-p", "evs", "-p", PLUGIN], "", marks=pytest.mark.slow),
        pytest.param([], "from evs.tools.testing import evs_loop\n", marks=pytest.mark.slow),
        pytest.param([], "pytest_plugins = ['evs']\n", marks=pytest.mark.slow),
    ],
)
def test_each_way_to_ask_for_it(tmp_path: Path, arguments: list[str], conftest: str) -> None:
    (tmp_path / "test_it.py").write_text("def test_it(evs_loop):\n    assert evs_loop\n")
    (tmp_path / "conftest.py").write_text(conftest)
    ran = run_pytest(tmp_path, "-W", "error", *arguments)
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


def test_importing_evs_for_it_stays_light() -> None:
    light = (
        "import sys, evs\n"
        "assert evs.pytest_plugins\n"
        "assert not {'numpy', 'mujoco', 'zmq', 'pytest', 'evs.drivers'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", light], env=environment(), check=True)
