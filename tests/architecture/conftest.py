"""What all house tests look at: the files of the checkout, tracked or about to be."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import pytest

IGNORED = {".git", ".venv", "build", "dist", "out", "__pycache__"}
OF_ROS = "drivers/ros2/evs_camera_ros/"
"""A package of its own, which colcon builds: no part of evs."""
PACKAGES = ("msgs", "emulator", "drivers", "tools", "examples", "launch", "lab")
"""Folders of evs; lab is evs-lab."""


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The top of the checkout."""
    return Path(__file__).parents[2]


@pytest.fixture(scope="session")
def files(checkout: Path) -> list[str]:
    """Every file of evs that git does not ignore, from the top. Without git: all but outputs."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=False,
    )
    if listing.returncode == 0:
        names = {name for name in listing.stdout.split("\0") if name}
    else:
        names = {
            str(path.relative_to(checkout))
            for path in checkout.rglob("*")
            if path.suffix != ".so"
            and not any(
                part in IGNORED or part.endswith("_cache") or part == ".hypothesis"
                for part in path.relative_to(checkout).parts
            )
        }
    # a file that was deleted but not committed yet is still listed
    return sorted(
        name for name in names if (checkout / name).is_file() and not name.startswith(OF_ROS)
    )


@pytest.fixture(scope="module")
def sources(checkout: Path, files: list[str]) -> dict[str, ast.Module]:
    """The syntax tree of every module of the package, by its path; no longer kept than needed."""
    return {
        name: ast.parse((checkout / name).read_text(), name)
        for name in files
        if name.endswith(".py")
        and name.split("/")[0] in PACKAGES
        and not name.startswith(("lab/tests/", "lab/docs/"))
    }
