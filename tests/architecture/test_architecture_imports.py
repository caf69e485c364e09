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


def test_import_evs_loads_nothing_else() -> None:
    modules = loaded_by("import evs")
    assert {name for name in modules if name.startswith("evs.")} == set()
    assert top(modules) & (HEAVY | {"numpy", "rich", "msgpack"}) == set()


def test_help_loads_nothing_heavy() -> None:
    modules = loaded_by("from evs.launch.main import main\nassert main(['--help']) == 0")
    assert top(modules) & HEAVY == set()
    assert "evs.emulator._core" not in modules


def test_importing_any_command_loads_nothing_heavy() -> None:
    modules = loaded_by(
        "from importlib import import_module\n"
        "from evs.launch.main import COMMANDS\n"
        "for name in COMMANDS.values(): import_module(name)"
    )
    assert top(modules) & HEAVY == set()
    assert "evs.emulator._core" not in modules


def test_a_heavy_import_would_be_seen() -> None:
    assert "zmq" in top(loaded_by("import evs.drivers.bus"))


@pytest.fixture(scope="module")
def package(checkout: Path) -> ast.Module:
    """The syntax tree of evs/__init__.py's template."""
    return ast.parse((checkout / "emulator/core/package_init.py.in").read_text())


def assigned(tree: ast.Module, name: str) -> object:
    """The value of a top-level assignment of plain values."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return ast.literal_eval(node.value)
    raise AssertionError(f"no {name}")


def test_the_three_lists_of_names_agree(package: ast.Module) -> None:
    homes = assigned(package, "_HOMES")
    assert isinstance(homes, dict)
    block = next(node for node in package.body if isinstance(node, ast.If))
    seen = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == homes
    assert assigned(package, "__all__") == sorted([*homes, "__version__"])


def test_every_name_that_evs_offers_is_there() -> None:
    import evs

    for name in evs.__all__:
        assert getattr(evs, name) is not None
        assert name in dir(evs)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        getattr(evs, "nonsense")  # noqa: B009


def test_the_version_is_told_once(checkout: Path) -> None:
    import evs

    assert (
        evs.__version__
        == (tomllib.loads((checkout / "pyproject.toml").read_text())["project"]["version"])
    )
