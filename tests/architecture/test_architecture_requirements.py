"""The two commands install what they promise, and every requirement has a pin that fits."""

from __future__ import annotations

import importlib.metadata
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def asked(checkout: Path, *extras: str) -> list[Requirement]:
    """What .ci/requirements.py prints."""
    printed = subprocess.run(
        [sys.executable, ".ci/requirements.py", *extras],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=True,
    )
    return [Requirement(line) for line in printed.stdout.splitlines()]


def test_every_requirement_has_a_pin_inside_its_range(checkout: Path) -> None:
    lines = (checkout / ".ci/constraints.txt").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if not line.startswith("#"))
    pins = {canonicalize_name(name): version for name, version in pins.items()}
    requirements = asked(checkout, "test", "build", "dev", "docs")
    assert len(requirements) > 20
    for requirement in requirements:
        assert requirement.specifier, requirement
        assert pins[canonicalize_name(requirement.name)] in requirement.specifier, requirement


@pytest.mark.parametrize(
    "name", ["mujoco", "pyrender2", "onnxruntime", "numpy", "pyzmq", "msgpack", "evs"]
)
def test_the_packages_of_the_card_are_installed(name: str) -> None:
    assert importlib.metadata.version(name)


def test_the_set_up_asks_for_the_packages_of_the_card(checkout: Path) -> None:
    names = {requirement.name for requirement in asked(checkout, "test", "build")}
    assert names >= {"mujoco", "pyrender2", "onnxruntime", "numpy", "pyzmq", "msgpack"}


CONDA = {
    "mujoco": "mujoco-python",
    "msgpack": "msgpack-python",
    "flatbuffers": "python-flatbuffers",
    "lazy-loader": "lazy_loader",
}
"""Distribution -> its package on conda-forge, where the names differ."""


def test_the_recipe_for_conda_has_the_same_version_and_ranges(checkout: Path) -> None:
    recipe = (checkout / ".ci/conda/recipe.yaml").read_text()
    project = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]
    assert f'  version: "{project["version"]}"\n' in recipe
    block = re.search(r"^  run:\n((?:    - .*\n)+)", recipe, re.MULTILINE)
    assert block is not None
    needed = re.findall(r"    - ([\w-]+) ?(.*)", block[1])
    wanted = [re.fullmatch(r"([\w-]+)(.*)", line).groups() for line in project["dependencies"]]
    assert needed == [("python", ""), *((CONDA.get(name, name), span) for name, span in wanted)]
