"""The interpreter exits while a daemon thread observes: no crash, no hang, nothing said."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.extremes

PROGRAM = """
import os, sys, threading
import mujoco
import numpy as np
import evs
from evs.emulator.config import ModelConfig
from evs.emulator.camera.pixel_pipeline import PixelPipeline
from evs.emulator.sensor import SensorParameters

XML = '''<mujoco><worldbody><light pos="0 0 2"/><geom type="plane" size="2 2 .1"/>
<body pos="0 0 .5"><freejoint/><geom size=".1"/></body>
<camera name="c" pos="0 -2 1" xyaxes="1 0 0 0 1 2"/></worldbody></mujoco>'''
began = threading.Event()

def steps():
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    sensor = evs.EventCamera(model, camera="c", seed=1)
    while True:
        mujoco.mj_step(model, data)
        sensor.observe(data)
        began.set()

def sees():
    sensor = SensorParameters("test", 640, 480, 0.2, 0.2)
    pixels = PixelPipeline(sensor, ModelConfig(), seed=1, threads=2)
    light = np.ones((2, 480, 640), np.float32)
    light[1] = 2
    for tick in range(10**9):
        pixels.see(light[tick % 2], 1000 * tick, 1000 * tick + 1000)
        if tick > 2:
            began.set()

ends = []
for _ in range(int(sys.argv[2])):
    child = os.fork()
    if not child:
        threading.Thread(target={"steps": steps, "sees": sees}[sys.argv[1]], daemon=True).start()
        assert began.wait(20)
        sys.exit()
    ends.append(os.waitpid(child, 0)[1])
print(sorted(set(ends)))
"""
BINDINGS = Path(__file__).parents[3] / "emulator" / "core" / "bindings"
TIMES = 10
"""most of them crashed"""


@pytest.mark.slow
@pytest.mark.parametrize("what", ["steps", "sees"])
def test_a_daemon_thread_observes_while_the_interpreter_exits(what: str) -> None:
    # a program of several threads is not forked to be of any use, but these have not begun
    command = [sys.executable, "-W", "ignore", "-c", PROGRAM, what, str(TIMES)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.stdout, done.stderr) == ("[0]\n", "")


def test_the_bindings_give_back_the_lock_in_one_way() -> None:
    """nanobind's own guards abort; see emulator/core/bindings/gil.h."""
    for file in sorted(BINDINGS.iterdir()):
        assert "gil_scoped" not in file.read_text(), file
