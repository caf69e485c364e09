"""The controller of the tutorial runs as it stands there, with the command above it."""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers.bus.address import free_address

pytestmark = pytest.mark.integration

ROOT = Path(__file__).parents[3]
ADDRESS = "tcp://127.0.0.1:5570"


def test_the_controller_of_the_tutorial_runs() -> None:
    page = (ROOT / "docs/tutorials/closed_loop.md").read_text()
    (section,) = re.findall(r"## In two processes\n(.*?)\n## ", page, re.DOTALL)
    words = re.findall(r"```sh\nevs (.*)\n", section)[0]
    (program,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    assert len([line for line in program.splitlines() if line]) <= 8
    # another port: that one may be in use on this machine
    address = free_address()
    assert ADDRESS in program
    command = [sys.executable, "-m", "evs.launch.main", *shlex.split(words)]
    command += [f"lockstep.address={address}", "render.spp=1", "loop.max_s=0.3"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as server:
        try:
            done = subprocess.run(
                [sys.executable, "-c", program.replace(ADDRESS, address)],
                capture_output=True, text=True, timeout=100, check=True,
            )  # fmt: skip
        finally:
            server.send_signal(signal.SIGINT)
            server.communicate(timeout=60)
    assert server.returncode == 0
    assert done.stdout == "300000 0.3 s are over\n"
