"""Importing costs nothing, and what evs offers is what type checkers see."""

from __future__ import annotations

import ast
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
    *("evs.emulator.base.memory_limits", "evs.msgs", "evs.msgs.errors", "evs.msgs.registry"),
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


LAZY = ("emulator", "emulator/render", "msgs", "tools/testing")
"""Packages whose names are imported at first use, besides evs itself."""


def assigned(tree: ast.Module, name: str) -> object:
    """The value of a top-level assignment of plain values."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return ast.literal_eval(node.value)
    raise AssertionError(f"no {name}")


@pytest.mark.parametrize("file", [f"{folder}/__init__.py" for folder in LAZY])
def test_the_three_lists_of_names_agree(checkout: Path, file: str) -> None:
    package = ast.parse((checkout / file).read_text())
    homes = assigned(package, "_HOMES")
    assert isinstance(homes, dict)
    block = next(node for node in package.body if isinstance(node, ast.If))
    # a second name of a class is assigned to it
    second = {
        ast.unparse(node.targets[0]): ast.unparse(node.value)
        for node in block.body
        if isinstance(node, ast.Assign)
    }
    seen = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    seen |= {new: seen[old] for new, old in second.items()}
    # "module", or "module:name"
    assert seen == {name: home.partition(":")[0] for name, home in homes.items()}
    for name, home in homes.items():
        assert home.partition(":")[2] in ("", second.get(name, name))
    assert sorted(assigned(package, "__all__")) == sorted(homes)


def test_every_name_that_evs_offers_is_there() -> None:
    import evs

    for name in evs.__all__:
        assert getattr(evs, name) is not None
        assert name in dir(evs)
    with pytest.raises(AttributeError, match="No evs attribute nonsense"):
        getattr(evs, "nonsense")  # noqa: B009


def test_the_version_is_the_same_everywhere(checkout: Path) -> None:
    import evs

    project, lab = (
        tomllib.loads((checkout / folder / "pyproject.toml").read_text())["project"]
        for folder in (".", "lab")
    )
    assert evs.__version__ == project["version"] == lab["version"]
    assert lab["dependencies"] == [f"evs[plot]=={evs.__version__}"]
    assert f"\nversion: {evs.__version__}\n" in (checkout / "CITATION.cff").read_text()
