"""Import paths that earlier pages named still work, for one version."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import evs

EARLIER_PAGES = """
from evs.drivers.dataset import Dataset
from evs.drivers.runner import job_threads, run_jobs, tell_share
from evs.drivers.testing import Push, replay
from evs.drivers.training.shards import read_shard
from evs.emulator.metrics.compare import compare
from evs.msgs.encodings import decode_evt3
import evs.drivers.dataset.textures
import evs.drivers.gym
"""


def ran(program: str, *options: str) -> subprocess.CompletedProcess[str]:
    """A program in a fresh interpreter."""
    command = [sys.executable, *options, "-c", program]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_what_pages_imported_still_imports() -> None:
    done = ran(EARLIER_PAGES, "-W", "ignore::DeprecationWarning")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("old", evs._MOVED)
def test_an_old_name_is_the_same_module(old: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, old, raising=False)
    new = evs._MOVED[old]
    with pytest.warns(DeprecationWarning, match=f"{old} is {new} now"):
        module = importlib.import_module(old)
    assert module is importlib.import_module(new)
    assert module.__name__ == new


def test_what_lies_below_a_moved_package_is_not_imported_twice() -> None:
    done = ran(
        "import evs.drivers.training.shards as old, evs.tools.training.shards as new\n"
        "assert old is new and old.__name__ == 'evs.tools.training.shards'",
        *("-W", "ignore::DeprecationWarning"),
    )
    assert done.returncode == 0, done.stderr


def test_the_warning_names_the_line_that_imports() -> None:
    done = ran("import warnings\nwarnings.simplefilter('error')\nimport evs.drivers.testing")
    assert done.returncode == 1
    assert 'File "<string>", line 3' in done.stderr
    assert "evs.drivers.testing is evs.tools.testing now" in done.stderr


def test_what_never_was_is_still_missing() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"evs\.drivers\.nonsense"):
        importlib.import_module("evs.drivers.nonsense")
