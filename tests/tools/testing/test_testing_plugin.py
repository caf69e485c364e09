"""The pytest plugin as its users have it: pytest in a process of its own, the page's example."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
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
    """pytest in `folder`, with the plugin, which an installed evs brings along by itself."""
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", PLUGIN, "-p", "no:cacheprovider", *arguments],
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


def test_the_example_of_the_page_works_as_written(tmp_path: Path) -> None:
    # but for its timing: no machine is slow enough for this
    patient = example().replace("median_us=2000, p99_us=20000", "median_us=1e9, p99_us=1e9")
    assert patient != example()
    (tmp_path / "test_balance.py").write_text(patient)
    ran = run_pytest(tmp_path, "-W", "error")
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


def test_the_example_can_fail_and_says_what_an_engineer_needs(tmp_path: Path) -> None:
    # the same controller with its sign turned pushes the pole over
    wrong = example().replace("12.0 * self.lean", "-12.0 * self.lean")
    assert wrong != example()
    (tmp_path / "test_balance.py").write_text(wrong)
    ran = run_pytest(tmp_path, f"--basetemp={tmp_path / 'kept'}")
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
        "    assert request.config.pluginmanager.hasplugin('" + PLUGIN + "')\n"
    )
    ran = run_pytest(tmp_path, "-W", "error")
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


def test_it_is_declared_and_named_so_that_it_is_never_loaded_twice(tmp_path: Path) -> None:
    project = tomllib.loads((PAGE.parents[2] / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["pytest11"] == {PLUGIN: PLUGIN}
    assert EntryPoint(PLUGIN, PLUGIN, "pytest11").load().evs_loop
    # installed, pytest loads it under its entry point's name; -p on top of that does no harm
    metadata = tmp_path / "installed/evs_again-1.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: evs_again\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(f"[pytest11]\n{PLUGIN} = {PLUGIN}\n")
    # pytest rewrites the asserts of every module that a plugin's distribution holds
    (metadata / "RECORD").write_text("evs/__init__.py,,\nevs/tools/testing/plugin.py,,\n")
    (tmp_path / "test_it.py").write_text("def test_it(evs_loop):\n    assert evs_loop\n")
    for arguments in ((), ("-p", PLUGIN)):
        ran = subprocess.run(
            [sys.executable, "-m", "pytest", "-W", "error", "-p", "no:cacheprovider", *arguments],
            cwd=tmp_path,
            env=environment(tmp_path / "installed"),
            capture_output=True,
            text=True,
            check=False,
        )
        assert "1 passed" in ran.stdout, ran.stdout + ran.stderr


def test_the_names_of_the_room_come_at_first_use() -> None:
    import evs.tools.testing as room

    assert set(room.__all__) <= set(dir(room))
    for name in room.__all__:
        assert getattr(room, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        getattr(room, "nonsense")  # noqa: B009
