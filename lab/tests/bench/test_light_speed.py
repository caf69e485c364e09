"""Time of a traced frame beside MuJoCo's own ray casting of the same pixels in the same run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from speed.turns import Table, milliseconds, target
from speed.view import FRAME, PRIMITIVES, SCENES, WIDE, Rays, View, robot, share_of_the_same_geoms

RAYS, DIRECT = "mj_multiRay, primary rays", "direct"
TWO, PATH, AVX2 = "direct, 2 threads", "path", "direct, AVX2"


def narrower(view: View) -> dict[str, Callable[[], np.ndarray]]:
    """The calls with AVX2, where the processor has it."""
    if "avx2" not in WIDE:
        return {}
    return {
        AVX2: view.light(1, isa="avx2"),
        "path, AVX2": view.light(1, renderer="path", isa="avx2"),
    }


@pytest.mark.bench
def test_direct_beside_mujoco_rays(robot_files: dict[str, Path], camera_rays: Rays) -> None:
    columns = {}
    for scene in SCENES:
        view = robot(robot_files[scene])
        assert share_of_the_same_geoms(view, camera_rays) > 0.995
        columns[scene] = milliseconds({
            RAYS: view.multi_ray(camera_rays),
            DIRECT: view.light(1),
            TWO: view.light(2),
            "direct, 4 spp": view.light(1, 4),
            "direct, 4 spp, 2 threads": view.light(2, 4),
            "adaptive, 4 spp": view.light(1, 4, antialiasing="adaptive"),
            "adaptive, 16 spp": view.light(1, 16, antialiasing="adaptive"),
            PATH: view.light(1, renderer="path"),
            "path, 4 spp, 2 threads": view.light(2, 4, renderer="path"),
        } | narrower(view))  # fmt: skip
    humanoid = SCENES[1]
    table = Table(
        f"direct beside MuJoCo's ray casting, {FRAME}; 1 sample a pixel, 1 thread",
        columns,
        {row: RAYS for row in (DIRECT, AVX2) if row in columns[humanoid]},
    )
    print(table)
    print(target(f"direct, {humanoid}", table.ratio(humanoid, DIRECT), 10, "x"))
    if AVX2 in columns[humanoid]:
        print(target(f"{AVX2}, {humanoid}", table.ratio(humanoid, AVX2), 6, "x"))
    table = Table(
        f"direct beside itself, {FRAME}; 1 sample a pixel and 1 thread unless said",
        columns,
        {row: DIRECT for row in columns[humanoid] if row not in (RAYS, DIRECT, AVX2)},
    )
    print(table)
    print(target(f"2 threads, {humanoid}", table.ratio(humanoid, TWO), 1.8, "x"))
    slower = 1 / table.ratio(humanoid, PATH)
    print(target(f"path, 1 sample, {humanoid}", slower, 6, "times the time of direct"))
    for scene in PRIMITIVES:
        print(target(f"{TWO}, {scene}", columns[scene][TWO].median, 1.0, "ms"))
