"""`evs doctor` looks at exactly what pyproject.toml asks for."""

import re
import tomllib
from pathlib import Path

from evs.tools.doctor import packages

PYPROJECT = Path(__file__).parents[3] / "pyproject.toml"


def test_the_packages_looked_at_are_those_required() -> None:
    project = tomllib.loads(PYPROJECT.read_text())["project"]

    def names(requirements: list[str]) -> tuple[str, ...]:
        return tuple(re.split(r"[<>=!~\[]", line)[0].strip() for line in requirements)

    assert names(project["dependencies"]) == packages.CORE
    extras = project["optional-dependencies"]
    tools = ("test", "build", "dev", "docs", "wheels")
    users = {key: names(extras[key]) for key in extras if key not in tools}
    assert users == packages.EXTRAS
    assert set(packages.USES) == set(packages.EXTRAS)


def test_the_ranges_looked_at_are_those_required() -> None:
    project = tomllib.loads(PYPROJECT.read_text())["project"]
    extras = project["optional-dependencies"]
    required = [
        *project["dependencies"],
        *(line for key in packages.EXTRAS for line in extras[key]),
    ]
    for line in required:
        name, asked = re.fullmatch(r"([\w-]+)([^;]*)(?:;.*)?", line).groups()
        assert packages.range_of(name) == asked
        # the signs that in_range knows
        assert re.fullmatch(r"(>=|<)[\d.]+(,(>=|<)[\d.]+)*", asked)
