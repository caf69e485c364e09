"""The command `evs` of a checkout, as .ci/link.py writes it."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def command(tmp_path: Path) -> Path:
    runpy.run_path(str(ROOT / ".ci" / "link.py"))["link"](ROOT, tmp_path, tmp_path)
    return tmp_path / "evs"


def test_it_runs(
    command: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["evs", "--version"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(command), run_name="__main__")
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("evs ")


def test_a_worker_that_loads_it_does_not_run_it(
    command: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # as multiprocessing's `spawn` does, in each process of --workers
    monkeypatch.setattr(sys, "argv", ["evs", "--version"])
    runpy.run_path(str(command), run_name="__mp_main__")
    assert capsys.readouterr().out == ""
