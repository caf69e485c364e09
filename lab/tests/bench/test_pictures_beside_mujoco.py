"""The page of pictures: other people's robots by MuJoCo's classic renderer and by evs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evs.drivers.pictures import write_png
from evs.emulator.config import RenderConfig
from reference.foreign_models import SCENES, in_even_light
from reference.mujoco_picture import MujocoPictures

OUT = Path(__file__).parents[3] / "docs" / "img" / "beside_mujoco.png"
WIDTH, HEIGHT = 240, 180


@pytest.mark.bench
def test_the_page_of_pictures_is_made(mujoco_beside: MujocoPictures) -> None:
    rows = []
    for scene in SCENES.values():
        render = RenderConfig(spp=16, antialiasing="fixed")
        views = [
            mujoco_beside.beside(model, None, scene.camera, WIDTH, HEIGHT, render=render)
            for model in (in_even_light(scene), scene.load())
        ]
        rows.append(np.hstack([picture for v in views for picture in (v.theirs, v.our_code)]))
    OUT.parent.mkdir(exist_ok=True)
    write_png(OUT, np.ascontiguousarray(np.vstack(rows)))
    print(f"\n{OUT.name}: {len(rows)} scenes, MuJoCo and evs in even light and as they are lit")
