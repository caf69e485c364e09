"""Print the requirements of pyproject.toml's dependencies and of the extras named, one a line.

An extra that lab/pyproject.toml has too is that of both. With --alone: those of the extras only.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path


def requirements(tables: dict[str, dict[str, list[str]]], extras: list[str]) -> list[str]:
    """What `pip install evs[extras] evs-lab[extras]` asks for; extras of extras are unfolded.

    Args:
        tables: Distribution -> its extras.
        extras: The names wanted; each is one of the first distribution or of all.
    """
    found: list[str] = []
    for table in tables.values():
        for requirement in (line for extra in extras for line in table.get(extra, [])):
            nested = re.fullmatch(r"([\w-]+)\[(.*)\]", requirement)
            if nested and nested[1] in tables:
                inner = {nested[1]: tables[nested[1]]}
                found += requirements(inner, nested[2].split(","))
            else:
                found.append(requirement)
    return list(dict.fromkeys(found))


if __name__ == "__main__":
    projects = [
        tomllib.loads(Path(folder, "pyproject.toml").read_text())["project"]
        for folder in (".", "lab")
    ]
    extras = sys.argv[1:]
    base = projects[0]["dependencies"]
    tables = {project["name"]: project["optional-dependencies"] for project in projects}
    if extras[:1] == ["--alone"]:
        base, extras = [], extras[1:]
    if unknown := [name for name in extras if not any(name in table for table in tables.values())]:
        sys.exit(f"no extra {', '.join(unknown)}")
    print("\n".join([*base, *requirements(tables, extras)]))
