"""Importing costs nothing, and what evs offers is what type checkers see."""

from __future__ import annotations

import importlib
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

HEAVY = {
    *("mujoco", "onnxruntime", "pyrender", "gymnasium", "imageio_ffmpeg", "av", "PIL", "zmq"),
    *("flatbuffers", "lz4", "zstandard", "scipy", "hypothesis", "pytest"),
}

COMMAND = {
    *("evs.launch", "evs.launch.main", "evs.launch.support", "evs.launch.support.plugins"),
    *("evs.emulator", "evs.emulator.base"),
    *("evs.emulator.base.memory_limits", "evs.msgs", "evs.msgs.errors"),
}
"""All of evs that the command loads before it knows what to run."""


def loaded_by(program: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after a program."""
    result = subprocess.run(
        [sys.executable, "-c", f"{program}\nimport sys\nprint(*sys.modules, file=sys.stderr)"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(result.stderr.split())


def top(modules: set[str]) -> set[str]:
    return {name.split(".")[0] for name in modules}


@pytest.fixture(scope="module")
def bare() -> set[str]:
    """Modules of an interpreter that has done nothing."""
    return loaded_by("pass")


@pytest.mark.parametrize(
    ("program", "ours"),
    [
        ("import evs", set()),
        ("from evs.launch.main import main\nassert main(['--version']) == 0", COMMAND),
        ("from evs.launch.main import main\nassert main(['--help']) == 0", COMMAND),
    ],
)
def test_import_evs_and_help_load_little_but_the_standard_library(
    program: str, ours: set[str], bare: set[str]
) -> None:
    new = loaded_by(program) - bare
    assert {name for name in new if name.startswith("evs.")} == ours
    # evs --help lists the commands of evs-lab
    assert "evs" in top(new) - sys.stdlib_module_names <= {"evs", "evs_lab", "lazy_loader"}


def test_importing_any_command_loads_nothing_heavy() -> None:
    modules = loaded_by(
        "from evs.launch.main import commands, module_of\nfor name in commands(): module_of(name)"
    )
    assert top(modules) & HEAVY == set()
    assert "evs.emulator._core" not in modules


def test_a_heavy_import_would_be_seen() -> None:
    assert "zmq" in top(loaded_by("import evs.drivers.bus"))


@pytest.mark.parametrize(
    "name", ["evs", "evs.emulator", "evs.emulator.render", "evs.msgs", "evs.tools.testing"]
)
def test_every_name_of_a_stub_is_there(name: str) -> None:
    package = importlib.import_module(name)
    assert package.__all__
    for each in package.__all__:
        assert getattr(package, each) is not None
        assert each in dir(package)
    with pytest.raises(AttributeError, match=f"No {name} attribute nonsense"):
        getattr(package, "nonsense")  # noqa: B009


def test_the_version_is_the_same_everywhere(checkout: Path) -> None:
    import evs

    project, lab = (
        tomllib.loads((checkout / folder / "pyproject.toml").read_text())["project"]
        for folder in (".", "lab")
    )
    assert evs.__version__ == project["version"] == lab["version"]
    assert lab["dependencies"][0] == f"evs[plot]=={evs.__version__}"
    assert f"\nversion: {evs.__version__}\n" in (checkout / "CITATION.cff").read_text()
