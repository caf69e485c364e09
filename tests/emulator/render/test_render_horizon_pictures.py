"""The horizon and a far checkered floor beside MuJoCo's classic renderer."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.config import RenderConfig
from reference.mujoco_picture import MujocoPictures

pytestmark = pytest.mark.statistical

WIDTH, HEIGHT = 96, 144
HORIZON = """<mujoco><statistic extent="1"/>
    <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/>
      <map zfar="50" haze=".4"/><rgba haze=".3 .3 .3 1"/></visual>
    <asset><texture type="skybox" builtin="flat" rgb1=".3 .3 .3" rgb2=".3 .3 .3" width="8"
                    height="48"/>
      <texture name="tiles" type="2d" builtin="checker" rgb1=".2 .2 .2" rgb2=".9 .9 .9"
               width="64" height="64"/>
      <material name="floor" {floor} specular="0"/></asset>
    <worldbody><camera pos="0 0 3" xyaxes="1 0 0 0 0 1" fovy="20"/>
      <geom type="plane" size="0 0 .1" material="floor"/></worldbody></mujoco>"""


@pytest.mark.parametrize("renderer", ["direct", "path"])
def test_above_the_floors_end_is_the_sky(renderer: str, mujoco_beside: MujocoPictures) -> None:
    # haze of the sky's colour, so that blending, which MuJoCo does in display code, shows nothing
    model = mujoco.MjModel.from_xml_string(HORIZON.format(floor='rgba=".9 .9 .9 1"'))
    render = RenderConfig(renderer=renderer, spp=16)
    seen = mujoco_beside.beside(model, None, "", WIDTH, HEIGHT, render=render)
    # the floor ends 0.7 zfar away; a row less for the pixels that it touches
    end = int(HEIGHT / 2 * (1 + 3 / 35 / np.tan(np.deg2rad(10)))) - 1
    assert end > HEIGHT / 2 + 30
    apart = np.abs(seen.our_code.astype(int) - seen.theirs)[:end]
    assert apart.max() <= 3
    assert seen.theirs[-1].min() > 200
    assert seen.our_code[-1].min() > 200
