"""Which Python, MuJoCo and host library go together with evs, tried one by one: a Markdown table.

    sh .ci/matrix.sh [--python VERSION...] [--mujoco VERSION...] [--host PACKAGE...]

In a fresh environment for each combination, uv installs the wheel of evs, MuJoCo and the host, and
host_probe.py looks at one of the host's scenes with an event camera. Every Python is tried with
every MuJoCo, and the hosts on one Python.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PYTHONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
HOST_PYTHON = "3.12"
MUJOCOS = ("3.3.0", "3.8.1", "3.17.0", "4.0.0")
ALONE = "mujoco"
HOSTS = {
    "gymnasium": ("gymnasium[mujoco]",),
    "gymnasium-robotics": ("gymnasium-robotics==1.4.2",),
    "metaworld": ("metaworld==3.1.1",),
    # what it imports and does not ask for
    "robosuite": ("robosuite==1.5.2", "opencv-python-headless<4.12"),
    "dm_control": ("dm_control==1.0.50",),
    "playground": ("playground", "mujoco-mjx=={mujoco}", "jax[cpu]"),
    "mujoco-warp": ("mujoco-warp",),
}
"""package -> what is installed for it; evs[gym] and MuJoCo always are"""

PROBE = Path(__file__).with_name("host_probe.py")
INSTALL_S, PROBE_S = 600, 600
MAX_REASON = 160


@dataclass
class Cell:
    """One combination."""

    python: str
    mujoco: str
    host: str
    reason: str = ""
    """why it does not work; empty: it does"""
    found: dict[str, Any] = field(default_factory=dict)
    """what the probe printed"""


class Matrix:
    """Tries combinations, each in an environment that is removed afterwards."""

    def __init__(self, wheels: Path, home: Path, uv: str) -> None:
        self._wheels, self._home, self._uv = wheels.resolve(), home, uv

    def interpreter(self, version: str) -> str:
        """The path of this Python; empty where there is none."""
        pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
        for found in (shutil.which(f"python{version}"), *pyenv.glob(f"{version}.*/bin/python")):
            if found is not None:
                words = [found, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
                done = subprocess.run(words, capture_output=True, text=True, check=False)
                if done.stdout.strip() == version:
                    return str(found)
        return ""

    def tried(self, python: str, interpreter: str, mujoco: str, host: str) -> Cell:
        """Install and probe one combination."""
        cell = Cell(python, mujoco, host)
        folder = self._home / f"{python}-{mujoco}-{host}"
        shutil.rmtree(folder, ignore_errors=True)
        try:
            self._run(f"venv -q --python {interpreter} {folder}".split(), 60)
            wanted = [f"evs[gym] @ {self._wheel(python).as_uri()}", f"mujoco=={mujoco}"]
            wanted += [word.format(mujoco=mujoco) for word in HOSTS.get(host, ())]
            words = ["pip", "install", "-q", "--python", str(folder), "--prerelease=if-necessary"]
            said = self._run([*words, *wanted], INSTALL_S)
            if said is not None:
                cell.reason = resolver_reason(said)
                return cell
            done = subprocess.run(
                [folder / "bin/python", PROBE, host],
                capture_output=True,
                text=True,
                timeout=PROBE_S,
                check=False,
                env={**os.environ, "MUJOCO_GL": "disable", "JAX_PLATFORMS": "cpu"},
            )
            if done.returncode:
                lines = [line for line in done.stderr.splitlines() if line.strip()]
                cell.reason = "fails: " + (lines[-1] if lines else f"exit code {done.returncode}")
            else:
                cell.found = json.loads(done.stdout.splitlines()[-1])
                if not cell.found["events"]:
                    cell.reason = "runs, but gives no event"
        except subprocess.TimeoutExpired as reason:
            cell.reason = f"nothing after {reason.timeout:g} s"
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        for path in (folder.resolve(), folder):
            cell.reason = cell.reason.replace(str(path), "...")
        cell.reason = cell.reason[:MAX_REASON]
        return cell

    def _wheel(self, python: str) -> Path:
        tag = "cp311-cp311" if python in ("3.10", "3.11") else "cp312-abi3"
        return max(self._wheels.glob(f"evs-*-{tag}-*_{platform.machine()}.whl"))

    def _run(self, words: list[str], limit_s: float) -> str | None:
        """Run uv. Returns what it printed where it failed."""
        done = subprocess.run(
            [self._uv, *words], capture_output=True, text=True, timeout=limit_s, check=False
        )
        return done.stderr if done.returncode else None


def resolver_reason(said: str) -> str:
    """The requirement that cannot be met, in one line."""
    text = " ".join(said.replace("╰─▶", " ").replace("│", " ").split())
    if found := re.search(r"Python>=?([\d.]+)", text):
        return f"needs Python {found[1]} or newer"
    for pattern in (
        r"(\S+) depends on (mujoco(?:-mjx)?[=<>~!]+[^\s,]+(?:,[<>=!~]+[^\s,]+)*)",
        r"(\S+) depends on (numpy[=<>~!]+[^\s,]+(?:,[<>=!~]+[^\s,]+)*)",
    ):
        if (found := re.search(pattern, text)) and not found[1].startswith("evs"):
            return f"{found[1].replace('==', ' ')} needs {found[2]}"
    if found := re.search(r"(?:no version of|no wheels? for|has no wheels) (\S+)", text):
        return f"no {found[1].replace('==', ' ')} for this Python"
    return text[:160]


def report(cells: Sequence[Cell], missing: Sequence[str], command: str) -> str:
    """The tables."""
    reasons: dict[str, int] = {}

    def shown(cell: Cell) -> str:
        return f"{reasons.setdefault(cell.reason, len(reasons) + 1)}" if cell.reason else "**ok**"

    mujocos = list(dict.fromkeys(cell.mujoco for cell in cells))
    at = {(cell.python, cell.host, cell.mujoco): cell for cell in cells}
    head = [
        f"| | {' | '.join(f'MuJoCo {one}' for one in mujocos)} |",
        "|---|" + "---|" * len(mujocos),
    ]
    lines = [
        f"{platform.system()}, {platform.machine()}. **ok** means that evs, installed from its "
        "wheel, saw the scene move. A number refers to the reason below the table.",
        "",
        *head,
    ]
    for python, host in dict.fromkeys((cell.python, cell.host) for cell in cells):
        name = f"Python {python}" + ("" if host == ALONE else f", {host}")
        row = (shown(at[python, host, mujoco]) for mujoco in mujocos)
        lines.append(f"| {name} | {' | '.join(row)} |")
    lines += ["", *(f"{number}. {reason}" for reason, number in reasons.items())]
    if missing:
        lines += ["", f"Not tested, because it was not installed: Python {', '.join(missing)}."]
    lines += ["", *costs(cells), "", f"*`{command}`*", ""]
    return "\n".join(lines)


def costs(cells: Sequence[Cell]) -> list[str]:
    """What an observation costs beside the host's own step, with the newest versions that work."""
    lines = [
        "The table compares the time of one observation (DAVIS346, all pipeline defaults) with "
        "that of a step of the library:",
        "",
        "| library | MuJoCo | its own step, ms | observations per step | one observation, ms |",
        "|---|---|---:|---:|---:|",
    ]
    for host in dict.fromkeys(cell.host for cell in cells):
        works = [cell for cell in cells if cell.host == host and not cell.reason]
        if works:
            found = works[-1].found
            lines.append(
                f"| {host} {found['versions'][host]} | {works[-1].mujoco} | "
                f"{found['step_ms']:.3g} | {found['observations']} | {found['observe_ms']:.3g} |"
            )
    return lines


def main() -> int:
    """Try every combination, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, add_help=True)
    parser.add_argument("--python", nargs="+", default=PYTHONS)
    parser.add_argument("--mujoco", nargs="+", default=MUJOCOS)
    parser.add_argument("--host", nargs="+", default=list(HOSTS), choices=list(HOSTS))
    parser.add_argument("--wheels", type=Path, default=Path("dist"))
    parser.add_argument("--uv", default="uv")
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    matrix = Matrix(args.wheels, Path("build/matrix"), args.uv)
    cells, missing = [], []
    for python in args.python:
        interpreter = matrix.interpreter(python)
        if not interpreter:
            missing.append(python)
            continue
        for host in [ALONE, *(args.host if python == HOST_PYTHON else ())]:
            for mujoco in args.mujoco:
                cell = matrix.tried(python, interpreter, mujoco, host)
                cells.append(cell)
                print(f"{python} {mujoco} {host}: {cell.reason or 'ok'}", file=sys.stderr)
    text = report(cells, missing, "sh .ci/matrix.sh --markdown lab/docs/measured/hosts.md")
    if args.markdown:
        args.markdown.write_text(text)
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
