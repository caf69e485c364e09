"""What a closed loop costs beside its world, and saving beside a bare copy of the same arrays.

`.venv/bin/pytest -m bench -s lab/tests/bench/test_closed_speed.py`
"""

from __future__ import annotations

import time
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop, World
from evs.emulator.config import SensorConfig
from evs.emulator.config.schema import DelayConfig

pytestmark = pytest.mark.bench
SCENE = Path(__file__).parents[3] / "config" / "scenes" / "cartpole.xml"


def medians(turns, *jobs):
    """Median ms of each job, in turns."""
    spent = [[] for _ in jobs]
    for _ in range(turns):
        for times, job in zip(spent, jobs, strict=True):
            began = time.process_time()
            job()
            times.append(1e3 * (time.process_time() - began))
    return [float(np.median(times)) for times in spent]


def test_a_step_beside_a_tick_of_its_world():
    small = SensorConfig("dvs128", width=32, height=32)

    def world():
        made = World(mujoco.MjModel.from_xml_path(str(SCENE)), threads=1)
        made.add_camera("onboard", sensor=small)
        return made

    bare = world()
    loop = ClosedLoop.around(world(), limits={"angle": (-9.0, 9.0)}, max_s=3600.0)
    late = ClosedLoop.around(world(), delays=DelayConfig(2000, 300.0, 0.01, 1000, 300.0))
    for one in (loop, late):
        one.reset()
    ctrl = np.zeros(1)
    tick, step, delayed = medians(
        3000, lambda: bare.step(ctrl), lambda: loop.step(ctrl), lambda: late.step(ctrl)
    )
    print(
        f"\n  a tick of the world {1e3 * tick:.0f} us; in a loop with limits and encoders "
        f"{1e3 * step:.0f} us ({step / tick:.2f} times), with delays, jitter and losses "
        f"{1e3 * delayed:.0f} us ({delayed / tick:.2f} times)"
    )


def test_saving_beside_a_copy(robot_files):
    world = World(robot_files["gymnasium/humanoid"], control="random", threads=1)
    world.add_camera(sensor="davis346")
    for _ in range(50):
        world.step()
    world.save()
    arrays = list(world.arrays().values())
    blob = world.save()
    copy, save, restore, small = medians(
        30,
        lambda: [array.tobytes() for array in arrays],
        world.save,
        lambda: world.restore(blob),
        lambda: world.save(compress=True),
    )
    size, whole = len(blob), sum(array.nbytes for array in arrays)
    print(
        f"\n  davis346, 346x260: {whole / 1e6:.2f} MB of arrays; a copy of them {copy:.2f} ms; "
        f"save {save:.1f} ms, {size / 1e6:.2f} MB; restore {restore:.1f} ms; "
        f"compressed {small:.0f} ms, {len(world.save(compress=True)) / 1e6:.2f} MB"
    )
    first = World(robot_files["gymnasium/humanoid"])
    began = time.process_time()
    _ = first.identity
    print(f"  digest of the model, once a world: {1e3 * (time.process_time() - began):.1f} ms")
