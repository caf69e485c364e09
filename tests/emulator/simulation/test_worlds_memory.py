"""Many steps and resets of many worlds leave nothing behind."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest

import evs
from evs.emulator import Worlds
from evs.emulator.simulation.stacked_arrays import StackedArrays
from reference.worlds_alone import SWING

WORLDS = 50


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


@pytest.mark.slow
@pytest.mark.parametrize("steps", [20_000, pytest.param(1_000_000, marks=pytest.mark.campaign)])
def test_memory_does_not_grow(steps: int, tmp_path: Path) -> None:
    scene = tmp_path / "swing.xml"
    scene.write_text(SWING)
    worlds = Worlds(scene, WORLDS, threads=2, sensors=("angle",), limits={"rate": (-20.0, 20.0)})
    worlds.add_camera("left", sensor=evs.SensorConfig(preset="ideal", width=16, height=12))
    grids = StackedArrays("voxel_grid", WORLDS, (16, 12))
    random = np.random.default_rng(1)
    before = 0
    for step in range(steps // WORLDS):
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
