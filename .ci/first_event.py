"""How long a wheel takes to its first event: python .ci/first_event.py WHEEL [FOLDER].

The packages that the wheel requires are downloaded into FOLDER first, which stands for a warm cache
of pip. Each of three tries then makes an environment, installs, and runs a program until the first
event. Ten starts of Python follow, and ten of the command. Prints a table: medians, and the range.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

INSTALLS, STARTS = 3, 10
PROGRAM = """
import evs, mujoco

model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><light pos="0 0 3"/>
<body pos="0 0 1"><freejoint/><geom size=".2"/></body><camera pos="0 -2 1" xyaxes="1 0 0 0 0 1"/>
</worldbody></mujoco>''')
data = mujoco.MjData(model)
camera = evs.EventCamera(model, sensor="davis346")
while not len(camera.observe(data)):
    mujoco.mj_step(model, data)
"""


def took(*command: str | Path) -> tuple[float, float]:
    """Seconds of a command, and those of processors that it used."""
    before, started = os.times(), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=tempfile.gettempdir())
    elapsed, after = time.perf_counter() - started, os.times()
    used = after.children_user + after.children_system
    return elapsed, used - before.children_user - before.children_system


def row(name: str, times: list[tuple[float, float]]) -> str:
    """A row of the table."""
    elapsed, used = ([each[k] for each in times] for k in (0, 1))
    return (
        f"| {name} | {len(times)} | {statistics.median(elapsed):.3g} "
        f"| {min(elapsed):.3g} to {max(elapsed):.3g} | {statistics.median(used):.3g} |"
    )


def main(wheel: Path, packages: Path) -> None:
    """Measure and print."""
    pip = ("-m", "pip", "--disable-pip-version-check", "-q")
    subprocess.run([sys.executable, *pip, "download", "-d", packages, wheel], check=True)
    stages: dict[str, list[tuple[float, float]]] = {}

    def measure(name: str, *command: str | Path) -> None:
        stages.setdefault(name, []).append(took(*command))

    with tempfile.TemporaryDirectory() as folder:
        for attempt in range(INSTALLS):
            environment = Path(folder, str(attempt))
            python = environment / "bin/python"
            measure("`python -m venv`", sys.executable, "-m", "venv", environment)
            offline = ("install", "--no-index", "--find-links", packages, wheel)
            measure("`pip install` of the wheel", python, *pip, *offline)
            measure("first program, until its first event", python, "-c", PROGRAM)
        three = zip(*stages.values(), strict=True)
        stages["all three"] = [tuple(map(sum, zip(*each, strict=True))) for each in three]
        for _ in range(STARTS):
            measure("`python -c pass`", python, "-c", "pass")
            measure("`python -c 'import evs'`", python, "-c", "import evs")
            measure("`evs --help`", environment / "bin/evs", "--help")
    print(
        "| | runs | seconds, median | range | processor seconds, median |\n|---|---:|---:|---|---:|"
    )
    print(*(row(name, times) for name, times in stages.items()), sep="\n")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        given = [Path(argument).resolve() for argument in sys.argv[1:]]
        main(given[0], given[1] if len(given) > 1 else Path(folder))
