"""The wheel holds the package and nothing else, and works away from the checkout."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from evs.emulator.base.gpu.compiler import ROOMS

pytestmark = pytest.mark.slow

GPU_ROOMS = tuple(f"emulator/core/{room}/" for room in ROOMS)
"""whose headers are compiled for a GPU where there is one"""


@pytest.fixture(scope="module")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built as `make wheel` does, of the objects of the core in place."""
    folder = tmp_path_factory.mktemp("wheel")
    defines = [
        "--config-settings=cmake.define.EVS_WERROR=ON",
        f"--config-settings=cmake.define.EVS_OBJECTS={checkout / 'build/native'}",
    ]
    unpacked = checkout / "build/headers/usr/include"
    if unpacked.exists():
        # this Python came without its C headers: those that the set-up fetched
        version = f"python{sys.version_info.major}.{sys.version_info.minor}"
        defines += [
            f"--config-settings=cmake.define.Python_INCLUDE_DIR={unpacked / version}",
            f"--config-settings=cmake.define.CMAKE_CXX_FLAGS=-isystem{unpacked}",
        ]
    built = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check", "--no-deps"]
        + ["--no-build-isolation", *defines, "-w", str(folder), str(checkout)],
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (found,) = folder.iterdir()
    return found


def test_it_holds_the_package_and_nothing_else(wheel: Path, files: list[str]) -> None:
    held = {
        re.sub(r"^evs/emulator/_core\..*\.so$", "evs/emulator/_core.so", name)
        for name in zipfile.ZipFile(wheel).namelist()
        if not re.match(r"evs-[\d.]+\.dist-info/", name)
    }
    expected = {
        f"evs/{name}"
        for name in files
        if name.split("/")[0]
        in ("msgs", "emulator", "drivers", "tools", "examples", "launch", "config")
        and (not name.startswith("emulator/core/") or name.startswith(GPU_ROOMS))
        and not (name.startswith(GPU_ROOMS) and name.endswith(".cpp"))
    }
    expected |= {
        *("evs/__init__.py", "evs/__init__.pyi", "evs/__main__.py", "evs/py.typed"),
        "evs/emulator/_core.so",
    }
    assert held == expected
    assert any(name.startswith("evs/config/sensors/") for name in held)


def test_that_of_evs_lab_holds_its_package_and_nothing_else(
    checkout: Path, files: list[str], tmp_path: Path
) -> None:
    words = ["wheel", "-q", "--disable-pip-version-check", "--no-deps", "--no-build-isolation"]
    built = subprocess.run(
        [sys.executable, "-m", "pip", *words, "-w", str(tmp_path), str(checkout / "lab")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (found,) = tmp_path.iterdir()
    held = {name for name in zipfile.ZipFile(found).namelist() if ".dist-info/" not in name}
    assert held == {
        f"evs_{name}"
        for name in files
        if name.startswith("lab/") and name.endswith(".py") and not name.startswith("lab/tests/")
    }


def test_it_works_away_from_the_checkout(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    program = (
        "import evs, evs.emulator._core as core, pathlib, importlib.metadata as metadata\n"
        "print(evs.__file__, core.__file__, metadata.version('evs'), sep='\\n')\n"
        "print(*(entry.value for entry in metadata.entry_points(name='evs')))\n"
        "assert not [e for e in metadata.entry_points(group='pytest11') if 'evs' in e.value]\n"
        "from evs.launch.main import main\n"
        "assert main(['--version']) == 0\n"
        "assert all(getattr(evs, name) is not None for name in evs.__all__)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    package, core, version, *_ = ran.stdout.splitlines()
    assert package == str(tmp_path / "site/evs/__init__.py")
    assert core.startswith(str(tmp_path / "site/evs/emulator/_core."))
    assert version == wheel.name.split("-")[1]
    assert "evs.__main__:main" in ran.stdout
