"""A loop of `evs loop` balanced over the wire by a process that has no simulator."""

from __future__ import annotations

import subprocess
import sys

from lockstep_stand_in import serving

from evs.emulator.simulation.closed_loop import ClosedLoop

PROCESS = """
import sys
from evs.launch.main import main
code = main(["loop", sys.argv[1], "--connect", sys.argv[2], "--seed", "3"])
emulator = "evs.emulator"
simulator = "mujoco", f"{emulator}.world", f"{emulator}._core", f"{emulator}.simulation.closed_loop"
print("simulator:", [name for name in simulator if name in sys.modules])
raise SystemExit(code)
"""


def controlled_apart(name: str, loop: ClosedLoop) -> str:
    """What the controller called `name` prints, in a process of its own, with seed 3."""
    with serving(loop) as server:
        done = subprocess.run(
            [sys.executable, "-c", PROCESS, name, server.address],
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    assert "simulator: []" in done.stdout
    return done.stdout
