"""Install the checkout into this Python as links, so that every edit is live.

Writes what `pip install` would: a .pth that leads to build/ns, the commands, and the metadata that
`importlib.metadata` reads. Run from the top of the checkout.

    python .ci/link.py [lab]      evs, and evs-lab too
"""

from __future__ import annotations

import shutil
import sys
import sysconfig
import tomllib
from pathlib import Path

# as pip writes it: sh starts Python, so that the path may be long or hold spaces; worker processes
# run it once more, under another name
SCRIPT = """#!/bin/sh
'''exec' "{python}" "$0" "$@"
' '''
import sys

from {module} import {function}

if __name__ == "__main__":
    sys.exit({function}())
"""


def link(checkout: Path, packages: Path, scripts: Path, folder: str = ".") -> None:
    """Make the package and the commands of a folder's pyproject.toml work."""
    project = tomllib.loads((checkout / folder / "pyproject.toml").read_text())["project"]
    package = project["name"].replace("-", "_")
    (packages / f"{package}.pth").write_text(f"{checkout / 'build' / 'ns'}\n")
    for name, target in project.get("scripts", {}).items():
        module, function = target.split(":")
        script = scripts / name
        script.write_text(SCRIPT.format(python=sys.executable, module=module, function=function))
        script.chmod(0o755)
    for old in packages.glob(f"{package}-*.dist-info"):
        shutil.rmtree(old)
    metadata = packages / f"{package}-{project['version']}.dist-info"
    metadata.mkdir()
    fields = [f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}"]
    fields += [f"Requires-Dist: {requirement}" for requirement in project["dependencies"]]
    for extra, requirements in project["optional-dependencies"].items():
        fields.append(f"Provides-Extra: {extra}")
        for requirement in requirements:
            name, _, condition = requirement.partition(";")
            where = f"({condition.strip()}) and " if condition else ""
            fields.append(f'Requires-Dist: {name}; {where}extra == "{extra}"')
    (metadata / "METADATA").write_text("\n".join([*fields, ""]))
    groups = {"console_scripts": project.get("scripts", {}), **project.get("entry-points", {})}
    lines: list[str] = []
    for group, entries in groups.items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in entries.items()), ""]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    (metadata / "RECORD").write_text(f"{package}.pth,,\n")


if __name__ == "__main__":
    for folder in (".", *sys.argv[1:]):
        paths = (Path(sysconfig.get_path(name)) for name in ("purelib", "scripts"))
        link(Path.cwd(), *paths, folder)
