"""Other people's robots beside MuJoCo's classic renderer: the same shapes, the same colours.

MuJoCo adds up lamps in display codes, evs in linear light, so colours are compared under light that
is the same from everywhere: there both show what the materials and textures say.
"""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.config import RenderConfig
from reference.foreign_models import SCENES, in_even_light
from reference.mujoco_picture import MujocoPictures, encoded

pytestmark = pytest.mark.statistical

CLOSE = 0.04
"""Code values (0 to 1) by which the same colour may differ: MuJoCo's mipmaps are another filter."""


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_other_peoples_robots_look_as_mujoco_shows_them(
    name: str, mujoco_beside: MujocoPictures
) -> None:
    scene = SCENES[name]
    seen = mujoco_beside.beside(
        in_even_light(scene), None, scene.camera, 240, 180, render=RenderConfig(spp=16)
    )
    same = seen.their_ids == seen.our_ids
    apart = np.abs(seen.theirs / 255.0 - encoded(np.clip(seen.ours, 0, 1))).max(axis=2)
    close = float((apart[same] <= CLOSE).mean())
    print(f"{name}: same thing {seen.shape_agrees:.4f}, of these close in colour {close:.4f}")
    # a picture, not one wall
    assert len(np.unique(seen.our_ids)) > 5
    assert seen.shape_agrees > scene.shape
    assert close > scene.colour
