"""Where evs cannot be built or run, `pip install` stops at once: one line names the way out."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BUILD = """
import platform, sys
from scikit_build_core.build import build_wheel
sys.platform, machine = sys.argv[1:3]
platform.machine = lambda: machine
build_wheel(sys.argv[3])
"""


def refused(checkout: Path, tmp_path: Path, system: str, machine: str) -> str:
    """What building a wheel prints on a system that evs does not run on."""
    ran = subprocess.run(
        [sys.executable, "-c", BUILD, system, machine, str(tmp_path)],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 7, ran.stderr
    (line,) = (ran.stdout + ran.stderr).splitlines()
    assert list(tmp_path.iterdir()) == []
    return line


@pytest.mark.parametrize("system", ["win32", "cygwin"])
def test_windows_is_refused(checkout: Path, tmp_path: Path, system: str) -> None:
    line = refused(checkout, tmp_path, system, "AMD64")
    assert "does not run on Windows" in line
    assert "WSL 2" in line


def test_an_intel_mac_is_refused(checkout: Path, tmp_path: Path) -> None:
    line = refused(checkout, tmp_path, "darwin", "x86_64")
    assert "does not run on Intel Macs" in line


def test_an_old_compiler_is_refused_before_anything_is_compiled(
    checkout: Path, tmp_path: Path
) -> None:
    """By CMake, for those who have no .ci: a compiler that says it is g++ 11."""
    compiler = shutil.which("g++")
    assert compiler is not None, "apt install g++"
    old = tmp_path / "g++"
    flags = "-U__GNUC__ -D__GNUC__=11 -Wno-builtin-macro-redefined"
    old.write_text(f'#!/bin/sh\nexec "{compiler}" {flags} "$@"\n')
    old.chmod(0o755)
    folder = Path(sys.executable).parent
    ran = subprocess.run(
        [folder / "cmake", "-S", "emulator/core", "-B", tmp_path / "build", "-G", "Ninja"]
        + [f"-DCMAKE_MAKE_PROGRAM={folder / 'ninja'}", f"-DCMAKE_CXX_COMPILER={old}"],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 1
    said = " ".join(ran.stderr.split())
    assert "g++ 11." in said
    assert "is too old for evs, g++ 12 or newer is needed" in said
    assert "CXX=g++-12" in said
