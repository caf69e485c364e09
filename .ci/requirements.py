"""Print the requirements of pyproject.toml's dependencies and of the extras named, one a line.

With --alone: those of the extras only.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path


def requirements(project: dict[str, dict[str, list[str]]], extras: list[str]) -> list[str]:
    """What `pip install evs[extras]` would ask for; an extra that names extras is unfolded."""
    found: list[str] = []
    for extra in extras:
        for requirement in project["optional-dependencies"][extra]:
            nested = re.fullmatch(r"evs\[(.*)\]", requirement)
            found += requirements(project, nested[1].split(",")) if nested else [requirement]
    return found


if __name__ == "__main__":
    table = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    extras = sys.argv[1:]
    base = table["dependencies"]
    if extras[:1] == ["--alone"]:
        base, extras = [], extras[1:]
    print("\n".join([*base, *requirements(table, extras)]))
