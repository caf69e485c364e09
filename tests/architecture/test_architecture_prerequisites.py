"""A machine that lacks something gets one line that names it and the fix, and exit code 2."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., subprocess.CompletedProcess[str]]

REAL_PYTHON = f'exec "{sys.executable}" "$@"'
OLD_PYTHON = 'case "$2" in *print*) echo 3.9 ;; *exit*) exit 1 ;; esac'
NO_VENV = f'case "$2" in *ensurepip*) exit 1 ;; esac\n{REAL_PYTHON}'
OLD_COMPILER = 'case "$1" in --version) echo "g++ 8.3.0" ;; *) exit 1 ;; esac'


@pytest.fixture
def machine(tmp_path: Path, checkout: Path) -> Run:
    """Runs a script of .ci on a machine that has coreutils and the commands given, nothing else."""

    def run(script: str, *arguments: str, **commands: str) -> subprocess.CompletedProcess[str]:
        folder = tmp_path / "bin"
        folder.mkdir()
        for tool in ("sh", "mktemp", "rm", "cat", "head", "dirname", "mkdir", "id"):
            found = shutil.which(tool)
            assert found
            (folder / tool).symlink_to(found)
        for name, body in commands.items():
            command = folder / {"cxx": "c++", "python": "python3"}.get(name, name)
            command.write_text(f"#!/bin/sh\n{body}\n")
            command.chmod(0o755)
        # a checkout where nothing was made or fetched yet
        shutil.copytree(checkout / ".ci", tmp_path / "checkout/.ci")
        return subprocess.run(
            ["/bin/sh", f"{tmp_path}/checkout/.ci/{script}", *arguments],
            env={"PATH": str(folder), "TMPDIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


REAL_COMPILER = f'PATH="{os.environ["PATH"]}" exec c++ "$@"'
WITHOUT_SHUFFLES = REAL_COMPILER.replace('"$@"', '-D__builtin_shufflevector=missing "$@"')
NO_VECTORS = f'case "$1" in --version) echo "g++ 11.3.0" ;; *) {WITHOUT_SHUFFLES} ;; esac'
"""as g++ 11, which knows C++20"""


def complaint(result: subprocess.CompletedProcess[str]) -> str:
    """The one line, after checking that it is one."""
    assert result.returncode == 2
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1
    return lines[0]


def test_a_fit_machine_names_its_python(machine: Run) -> None:
    result = machine("prerequisites.sh", python=REAL_PYTHON, cxx=REAL_COMPILER)
    assert (result.returncode, result.stdout, result.stderr) == (0, "python3\n", "")


@pytest.mark.parametrize(
    ("commands", "says", "fix"),
    [
        ({"cxx": REAL_COMPILER}, "Python 3.11 or newer is missing", "apt install python3"),
        ({"python": OLD_PYTHON, "cxx": REAL_COMPILER}, "python3 is 3.9", "apt install"),
        (
            {"python": NO_VENV, "cxx": REAL_COMPILER},
            "venv module of python3 is missing",
            "apt install python3-venv",
        ),
        ({"python": REAL_PYTHON}, "C++20 compiler is missing", "apt install g++"),
        (
            {"python": REAL_PYTHON, "cxx": OLD_COMPILER},
            "c++ cannot build evs (g++ 8.3.0)",
            "apt install g++-12",
        ),
        (
            {"python": REAL_PYTHON, "cxx": NO_VECTORS},
            "c++ cannot build evs (g++ 11.3.0)",
            "CXX=g++-12",
        ),
    ],
)
def test_what_is_missing(machine: Run, commands: dict[str, str], says: str, fix: str) -> None:
    line = complaint(machine("prerequisites.sh", **commands))
    assert says in line
    assert fix in line


def test_a_newer_python_beside_an_old_one_is_taken(machine: Run) -> None:
    commands = {"python": OLD_PYTHON, "python3.12": REAL_PYTHON, "cxx": REAL_COMPILER}
    assert machine("prerequisites.sh", **commands).stdout == "python3.12\n"


def test_python_without_headers_and_no_apt(machine: Run, tmp_path: Path) -> None:
    body = f'case "$2" in *sysconfig*) echo "{tmp_path}" ;; *) {REAL_PYTHON} ;; esac'
    line = complaint(machine("headers.sh", "python3", python=body))
    assert "Python.h of Python 3." in line
    assert "apt install python3-dev" in line


def test_python_with_headers_needs_nothing(machine: Run, tmp_path: Path) -> None:
    (tmp_path / "Python.h").touch()
    body = f'case "$2" in *sysconfig*) echo "{tmp_path}" ;; esac'
    result = machine("headers.sh", "python3", python=body)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
