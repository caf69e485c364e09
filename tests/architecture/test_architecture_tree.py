"""What may lie where, and what may not be written anywhere."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

TOP = {
    *("emulator", "drivers", "msgs", "launch", "tests", "config", "README.md"),
    *("tools", "examples", "lab"),
    *("pyproject.toml", "Makefile", "LICENSE", "CHANGELOG.md", "CONTRIBUTING.md", "docs"),
    *("CITATION.cff", "__init__.pyi"),
}
OF_NO_FOLDER = {"architecture", "bench", "docs", "network_link", "support", "versions"}
"""Folders of tests/ that mirror no folder of the package."""


def test_the_top_level_is_fixed(files: list[str]) -> None:
    top = {name.split("/")[0] for name in files}
    assert {name for name in top if not name.startswith(".")} == TOP


def test_folders_that_are_no_packages_hold_no_init(files: list[str]) -> None:
    inits = [name for name in files if name.endswith("__init__.py")]
    assert [name for name in inits if name.split("/")[0] in ("launch", "tests", "config")] == []


def test_every_folder_of_a_package_has_its_init(files: list[str]) -> None:
    modules = {
        Path(name).parent
        for name in files
        if name.endswith(".py")
        and name.split("/")[0] in ("msgs", "emulator", "drivers", "tools", "examples", "lab")
        and not name.startswith("lab/tests/")
    }
    assert [str(folder) for folder in modules if f"{folder}/__init__.py" not in files] == []


def test_config_is_data(files: list[str]) -> None:
    assert [name for name in files if name.startswith("config/") and name.endswith(".py")] == []


def test_tests_mirror_the_package_under_unique_names(files: list[str]) -> None:
    tests = [
        name.partition("tests/") for name in files if name.startswith(("tests/", "lab/tests/"))
    ]
    modules = [Path(top, rest) for top, _, rest in tests if re.search(r"(^|/)test_\w+\.py$", rest)]
    folders = {Path(name).parent for name in files}
    mirrored = [path for path in modules if not OF_NO_FOLDER & set(path.parts[:2])]
    assert mirrored
    assert [str(path) for path in mirrored if path.parent not in folders] == []
    names = [path.name for path in modules]
    assert sorted(set(names)) == sorted(names)


LAZY = ast.dump(
    ast.parse("__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)").body[0]
)


def other_than_reexports(tree: ast.Module) -> list[str]:
    """What an __init__.py does besides a docstring, imports, tables and a lazy __getattr__."""
    found = []
    for node in tree.body:
        docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        table = isinstance(node, ast.Assign | ast.AnnAssign) and not any(
            isinstance(part, ast.Call) for part in ast.walk(node)
        )
        lazy = isinstance(node, ast.FunctionDef) and node.name in ("__getattr__", "__dir__")
        lazy |= ast.dump(node) == LAZY
        typing = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        imports = isinstance(node, ast.Import | ast.ImportFrom)
        if not (docstring or table or lazy or typing or imports):
            found.append(ast.unparse(node))
    return found


def test_an_init_only_reexports(checkout: Path, files: list[str]) -> None:
    inits = {
        name: ast.parse((checkout / name).read_text())
        for name in files
        if name.endswith("__init__.py")
    }
    assert inits
    assert {p: other_than_reexports(t) for p, t in inits.items() if other_than_reexports(t)} == {}


@pytest.mark.parametrize(
    "source", ["class A: pass", "def f(): pass", "X = load()", "for x in y: z"]
)
def test_an_init_that_does_more_is_found(source: str) -> None:
    assert other_than_reexports(ast.parse(source)) != []
