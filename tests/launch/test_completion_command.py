"""Completion: what a shell is offered, asked as bash asks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from evs.launch.main import commands, main
from reference.shell import offered

Capture = pytest.CaptureFixture[str]


@pytest.mark.integration
def test_commands_options_choices_and_files(tmp_path: Path) -> None:
    (tmp_path / "run.aedat4").touch()
    (tmp_path / "robot.xml").touch()
    assert {word.strip() for word in offered("evs ", tmp_path)} == set(commands())
    assert offered("evs emu", tmp_path) == ["emulate "]
    assert "--camera " in offered("evs view --ca", tmp_path)
    assert offered("evs completion f", tmp_path) == ["fish "]
    assert offered("evs info ru", tmp_path) == ["run.aedat4 "]
    assert offered("evs nonsense x", tmp_path) == [""]


@pytest.mark.integration
def test_keys_pipelines_and_scenes(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").touch()
    assert "render.spp=" in [word.strip() for word in offered("evs emulate render.sp", tmp_path)]
    assert "balanced" in [word.strip() for word in offered("evs emulate bal", tmp_path)]
    assert "robot.xml" in [word.strip() for word in offered("evs emulate robo", tmp_path)]


def test_bash_takes_it(tmp_path: Path, capsys: Capture) -> None:
    assert main(["completion", "bash"]) == 0
    (tmp_path / "lines").write_text(capsys.readouterr().out)
    (tmp_path / "evs").write_text(f'#!/bin/sh\nexec {sys.executable} -m evs.launch.main "$@"\n')
    (tmp_path / "evs").chmod(0o755)
    script = (
        "source ./lines; COMP_LINE='evs dem' COMP_POINT=7 COMP_TYPE=9; "
        "COMP_WORDS=(evs dem) COMP_CWORD=1; "
        '_python_argcomplete evs dem evs; echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "--norc", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.stdout.split() == ["demo"], done.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_has_its_lines(shell: str, capsys: Capture) -> None:
    assert main(["completion", shell]) == 0
    assert "_ARGCOMPLETE" in capsys.readouterr().out


def test_an_unknown_shell_is_one_line(capsys: Capture) -> None:
    assert main(["completion", "tcsh"]) == 2
    assert "invalid choice: 'tcsh'" in capsys.readouterr().err
