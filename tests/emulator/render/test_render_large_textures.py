"""Large images: the light of small ones, in a few bytes a texel."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.base.scene import F32, U8
from reference.instants import Film
from reference.memory import PEAK

SIDE = 2048
"""from which on level 0 is kept in bytes"""


def picture_of(side: int, repeat: int, fill: U8 | None, rgb: bool, renderer: str) -> F32:
    """Light of a plane with an image, seen from near the ground."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><asset>
      <texture name="t" type="2d" builtin="flat" width="{side}" height="{side}"/>
      <material name="m" texture="t" texrepeat="{repeat} {repeat}" specular="0" rgba="1 .8 .6 1"/>
      </asset><worldbody><light pos="0 0 2" castshadow="false" diffuse=".9 .8 .7"/>
      <geom type="plane" size="1 1 1" material="m"/>
      <camera pos=".1 -.1 .02" xyaxes="1 0 0 0 .3 1" fovy="60"/></worldbody></mujoco>""")
    if fill is not None:
        model.tex_data[:] = fill.ravel()
    return Film(model, (48, 36)).light(rgb=rgb, renderer=renderer, spp=4)


@pytest.mark.parametrize("renderer", ["direct", "hybrid", "path"])
@pytest.mark.parametrize("rgb", [False, True])
def test_light_is_that_of_a_small_image_that_repeats(renderer: str, rgb: bool) -> None:
    """From the foot of the camera, where a pixel is a part of a texel, to the horizon."""
    tile = np.random.default_rng(1).integers(0, 256, (SIDE // 2, SIDE // 2, 3), np.uint8)
    small = picture_of(SIDE // 2, 2, tile, rgb, renderer)
    large = picture_of(SIDE, 1, np.tile(tile, (2, 2, 1)), rgb, renderer)
    assert small.std() > 0.1 * small.mean()
    np.testing.assert_allclose(large, small, rtol=2e-3, atol=1e-4)


FOLDERS = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "support")]
PEAK_OF = f"""{PEAK}
sys.path[:0] = {FOLDERS}
from test_render_large_textures import picture_of
picture_of(int(sys.argv[1]), 1, None, True, sys.argv[2])
print(peak_kib())
"""


@pytest.mark.slow
@pytest.mark.parametrize("renderer", ["direct", "hybrid", "path"])
def test_a_texel_takes_few_bytes(renderer: str) -> None:
    """At the peak: those of MuJoCo, of the scene, of level 0 and of the smaller levels."""
    peaks = [
        int(subprocess.check_output([sys.executable, "-c", PEAK_OF, str(side), renderer]))
        for side in (64, SIDE)
    ]
    assert 1024 * (peaks[1] - peaks[0]) / SIDE**2 < 30
