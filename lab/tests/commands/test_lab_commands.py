"""The commands that evs-lab adds: each is a module, is listed, and describes itself."""

from __future__ import annotations

from pathlib import Path

import pytest

import evs_lab.commands
from evs.launch import main


def test_every_command_is_listed_and_describes_itself(capsys: pytest.CaptureFixture[str]) -> None:
    listed = [name for group in evs_lab.commands.GROUPS.values() for name in group]
    modules = {path.stem for path in Path(evs_lab.commands.__file__).parent.glob("[a-z]*.py")}
    assert set(listed) == set(main.LAB) == modules - {"stress_cases"}
    for name in listed:
        with pytest.raises(SystemExit) as ended:
            main.main([name, "--help"])
        assert ended.value.code == 0
        assert capsys.readouterr().out.startswith(f"usage: evs {name}")
