"""The committed type stub of the native core, and how many parameters functions have."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path


def test_the_stub_is_up_to_date(checkout: Path, tmp_path: Path) -> None:
    written = tmp_path / "_core.pyi"
    subprocess.run(
        [sys.executable, "-m", "nanobind.stubgen"]
        + ["-q", "-m", "evs.emulator._core", "-o", str(written)],
        check=True,
    )
    assert (checkout / "emulator/_core.pyi").read_text() == written.read_text(), "run: make stubs"


def test_no_function_has_over_16_parameters(checkout: Path) -> None:
    """Neither Python's nor, by the stub, the core's."""
    folders = "emulator", "drivers", "launch", "tools", "msgs", "examples", "lab"
    paths = [path for folder in folders for path in (checkout / folder).rglob("*.py*")]
    of_all = {
        f"{path}:{node.lineno}": {a.arg for a in ast.walk(node.args) if isinstance(a, ast.arg)}
        for path in paths
        if path.suffix in (".py", ".pyi")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert len(of_all) > 3000
    assert [place for place, names in of_all.items() if len(names - {"self", "cls"}) > 16] == []
