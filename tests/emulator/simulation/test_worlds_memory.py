"""Worlds keep nothing from step to step and from reset to reset, and go with their last name."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.drivers.search_path import search_path
from evs.emulator import Worlds
from evs.emulator.config import SensorConfig
from evs.emulator.simulation.stacked_arrays import StackedArrays
from reference.memory import resident_bytes
from reference.worlds_alone import SWING

SMALL = SensorConfig("dvs128", width=24, height=16)
OTHER = SensorConfig("dvs128", width=24, height=16, pos_thres=0.4)
COUNT, TICKS = 4, 2
WORLDS = 50
"""of a million steps"""
MOST_BYTES = 64
"""in each tick of a world: less than the least list or array that it could keep"""


def swings(control: Any = "auto") -> Worlds:
    worlds = Worlds(
        mujoco.MjModel.from_xml_string(SWING),
        COUNT,
        control=control,
        threads=2,
        sensors=("rate",),
        limits={"angle": (-50.0, 50.0)},
    )
    worlds.add_camera("left", sensor=SMALL)
    return worlds


def live(worlds: Worlds, rounds: int) -> int:
    """Step, reset, save and restore in turn; how many events there were."""
    events, blobs = 0, worlds.save()
    for number in range(rounds):
        controls = np.sin(number + np.arange(COUNT))[:, None]
        (seen,) = worlds.step(controls, ticks=TICKS)
        events += len(seen.events)
        if number % 20 == 0:
            # another scene too, in a model of its own
            scene = {"geom.rod.rgb.r": number % 7 / 10, "body.arm.mass": 1.0 + number % 5}
            worlds.reset(number, [number % COUNT], scene=scene)
        if number % 50 == 0:
            blobs = worlds.save()
            worlds.restore(blobs[::-1])
        if number % 100 == 0:
            # an unstable world, and a sensor that is exchanged
            worlds.world(0).data.qvel[0] = 1e13
            worlds.step()
            assert [*worlds.ended] == [0]
            worlds.reset(worlds=[0], sensor=OTHER)
            worlds.step()
            worlds.reset(worlds=[0], sensor=SMALL)
    return events


def grown(go_on: Callable[[], None], ticks: int) -> float:
    """Bytes that every tick of a world adds, in the one of four windows where it is least.

    What stays behind does so in each of them; an allocator takes a page or two in some.
    """
    go_on()
    sizes = [resident_bytes()]
    for _ in range(4):
        go_on()
        sizes.append(resident_bytes())
    return float(np.diff(sizes).min()) / (ticks * COUNT)


def constant(t_s: float, data: Any) -> list[float]:
    return [0.1]


def grown_in(case: str) -> float:
    """Bytes that a tick of a world adds, in a process that has nothing else in it."""
    if case == "kept":
        worlds, kept = swings(), []

        def go_on() -> None:
            for number in range(400):
                worlds.step(ticks=TICKS)
                kept.extend(np.full(64, number, np.float64) for _ in range(TICKS * COUNT))

        # fill what the start left free
        go_on()
        return grown(go_on, 400 * TICKS)
    worlds = swings("auto" if case == "together" else constant)
    assert bool(worlds.one_by_one) == (case != "together")
    rounds = 700 if case == "together" else 200
    assert live(worlds, 50) > 0
    return grown(lambda: live(worlds, rounds), rounds * TICKS)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["together", "one by one", "kept"])
def test_steps_and_resets_leave_no_memory_behind(case: str) -> None:
    # what tests before left free would hide what is kept
    done = subprocess.run(
        [sys.executable, __file__, case],
        env={**os.environ, "PYTHONPATH": search_path()},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    # an array of 64 numbers that is kept in each tick is found
    assert (float(done.stdout) > MOST_BYTES) == (case == "kept")


def test_worlds_that_nobody_has_are_gone() -> None:
    worlds = swings()
    (seen,) = worlds.step(ticks=3)
    refs = [weakref.ref(worlds), weakref.ref(worlds.world(1)), weakref.ref(worlds.world(2).physics)]
    del worlds
    gc.collect()
    assert [one() for one in refs] == [None] * 3
    # the events are their own
    assert len(seen) == COUNT


@pytest.mark.slow
@pytest.mark.campaign
def test_a_million_steps_leave_no_memory_behind(tmp_path: Path) -> None:
    scene = tmp_path / "swing.xml"
    scene.write_text(SWING)
    worlds = Worlds(scene, WORLDS, threads=2, sensors=("angle",), limits={"rate": (-20.0, 20.0)})
    worlds.add_camera("left", sensor=SensorConfig(preset="ideal", width=16, height=12))
    grids = StackedArrays("voxel_grid", WORLDS, (16, 12))
    random = np.random.default_rng(1)
    before = 0
    for step in range(1_000_000 // WORLDS):
        (seen,) = worlds.step(random.uniform(-1, 1, (WORLDS, 1)), ticks=2)
        grids.encode(seen, worlds.t_us - 2000, worlds.t_us)
        again = {*random.choice(WORLDS, 2).tolist(), *worlds.ended}
        worlds.reset(
            seed=[int(one) for one in random.integers(1000, size=len(again))], worlds=again
        )
        if step == 60:
            before = resident_bytes()
    assert before
    # a world is 0.2 MB here, so a thousandth of one a step would show
    assert resident_bytes() - before < 8e6


if __name__ == "__main__":
    print(grown_in(sys.argv[1]))
