"""Time of a traced frame of robosuite's Panda, 141 k triangles, beside MuJoCo's ray casting."""

from __future__ import annotations

import pytest

from speed.elsewhere import AbsentError
from speed.panda import panda
from speed.turns import Table, Time, milliseconds, target
from speed.view import HEIGHT, WIDTH, Rays, share_of_the_same_geoms

RAYS = "mj_multiRay, primary rays"
TWO = "direct, 2 threads"
SCENES = {"as robosuite lights it": False, "its lamp casts shadows": True}


@pytest.mark.bench
def test_panda(pytestconfig: pytest.Config, camera_rays: Rays) -> None:
    columns: dict[str, dict[str, Time]] = {}
    for scene, shadows in SCENES.items():
        try:
            view = panda(pytestconfig.rootpath, shadows)
        except AbsentError as absent:
            print(f"\nPanda: {absent}")
            return
        assert view.model.nmeshface > 140_000
        assert share_of_the_same_geoms(view, camera_rays) > 0.99
        columns[scene] = milliseconds({
            RAYS: view.multi_ray(camera_rays),
            "direct, 1 thread": view.light(1),
            TWO: view.light(2),
            "direct, 4 spp, 2 threads": view.light(2, 4),
        })  # fmt: skip
    ours = [row for row in columns["as robosuite lights it"] if row != RAYS]
    title = f"robosuite's Panda, 141 k triangles, {WIDTH}x{HEIGHT}, full frame, 1 sample a pixel"
    print(Table(title, columns, dict.fromkeys(ours, RAYS)))
    for scene, times in columns.items():
        print(target(f"{TWO}, {scene}", times[TWO].median, 6, "ms"))
