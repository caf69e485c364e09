"""Install the checkout into this Python as links, so that every edit is live.

Writes what `pip install` would: a .pth that leads to build/ns, the commands, and the metadata that
`importlib.metadata` reads. Run from the top of the checkout.
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


def link(checkout: Path, packages: Path, scripts: Path) -> None:
    """Make `import evs` and the commands of pyproject.toml work."""
    project = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]
    (packages / "evs.pth").write_text(f"{checkout / 'build' / 'ns'}\n")
    for name, target in project["scripts"].items():
        module, function = target.split(":")
        script = scripts / name
        script.write_text(SCRIPT.format(python=sys.executable, module=module, function=function))
        script.chmod(0o755)
    for old in packages.glob("evs-*.dist-info"):
        shutil.rmtree(old)
    metadata = packages / f"evs-{project['version']}.dist-info"
    metadata.mkdir()
    fields = ["Metadata-Version: 2.1", "Name: evs", f"Version: {project['version']}"]
    fields += [f"Requires-Dist: {requirement}" for requirement in project["dependencies"]]
    for extra, requirements in project["optional-dependencies"].items():
        fields.append(f"Provides-Extra: {extra}")
        for requirement in requirements:
            name, _, condition = requirement.partition(";")
            where = f"({condition.strip()}) and " if condition else ""
            fields.append(f'Requires-Dist: {name}; {where}extra == "{extra}"')
    (metadata / "METADATA").write_text("\n".join([*fields, ""]))
    groups = {"console_scripts": project["scripts"], **project.get("entry-points", {})}
    lines: list[str] = []
    for group, entries in groups.items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in entries.items()), ""]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    (metadata / "RECORD").write_text("evs.pth,,\n")


if __name__ == "__main__":
    link(Path.cwd(), Path(sysconfig.get_path("purelib")), Path(sysconfig.get_path("scripts")))
