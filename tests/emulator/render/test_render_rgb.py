"""Colour beside luminance: asked for or not, the luminance keeps its bytes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.config import CameraConfig
from reference.closed_forms import linear
from reference.instants import Film

WEIGHTS = np.array([0.2126, 0.7152, 0.0722])

SCENE = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset>
    <texture name="t" type="2d" builtin="checker" rgb1=".9 .2 .1" rgb2=".1 .3 .8" width="32"
      height="32"/>
    <material name="t" texture="t" texrepeat="3 3" reflectance=".2"/>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .9" rgb2=".1 .1 .2" width="16"
      height="96"/>
  </asset>
  <worldbody>
    <light type="directional" dir=".2 .3 -1" diffuse="{tint}" specular=".5 .5 .5"/>
    <geom type="plane" size="1 1 .1" material="t"/>
    <body pos="0 0 .5"><freejoint/><geom size=".3" rgba=".2 .8 .3 1"/></body>
    <geom type="box" size=".2 .2 .2" pos=".6 0 .3" rgba=".8 .1 .9 .4"/>
  </worldbody>
</mujoco>"""
VIEW = CameraConfig(lookat=(0, 0, 0.2), distance=2.2, azimuth=70, elevation=-25)


@pytest.mark.parametrize("isa", _core.isa_available())
@pytest.mark.parametrize(("tint", "channels"), [(".8 .8 .8", (1, 4)), (".9 .5 .2", (3, 3))])
def test_luminance_is_byte_equal_and_is_the_weighted_colour(
    tint: str, channels: tuple[int, int], isa: str
) -> None:
    film = Film(SCENE.format(tint=tint), (57, 43), VIEW)
    plain, colour = film.renderer(spp=3, isa=isa), film.renderer(2, rgb=True, spp=3, isa=isa)
    assert (plain._caster.channels, colour._caster.channels) == channels
    pixels = np.array([[0, 0], [30, 20], [56, 42]], np.int32)
    for shot in film.snapshots(5):
        pose = shot.cameras[0]
        assert colour.render(shot, pose).tobytes() == plain.render(shot, pose).tobytes()
        assert (
            colour.trace(shot, pose, pixels).tobytes() == plain.trace(shot, pose, pixels).tobytes()
        )
    # kept where nothing moved, as the luminance is
    assert colour.traced_fraction < 1
    assert colour.rgb is not None
    assert colour.rgb.shape == (43, 57, 3)
    luminance = colour.render(shot, pose)
    np.testing.assert_allclose(colour.rgb @ WEIGHTS, luminance, rtol=1e-4, atol=1e-6)
    anew = film.renderer(rgb=True, spp=3, isa=isa)
    anew.render(shot, pose)
    np.testing.assert_array_equal(anew.rgb, colour.rgb)
    assert plain.rgb is None


@pytest.mark.parametrize("look", ['rgba="1 .5 0 1"', 'material="image"', 'material="tinted"'])
def test_a_red_box_in_white_light_is_red(look: str) -> None:
    model = mujoco.MjModel.from_xml_string(f"""
      <mujoco><visual><headlight active="0"/></visual><asset>
        <texture name="t" type="2d" builtin="flat" rgb1="1 .50001 0" width="4" height="4"/>
        <texture name="white" type="cube" builtin="flat" rgb1="1 1 1" width="4" height="24"/>
        <material name="image" texture="t"/>
        <material name="tinted" texture="white" rgba="1 .5 0 1"/>
      </asset><worldbody>
        <light type="directional" dir="0 0 -1" diffuse="1 1 1" specular="0 0 0"/>
        <camera name="c" pos="0 0 2"/>
        <geom type="box" size="5 5 .1" {look}/>
      </worldbody></mujoco>""")
    film = Film(model, (4, 4))
    renderer = film.renderer(rgb=True, spp=None)
    renderer.render(film.shot, film.shot.cameras[0])
    # MuJoCo's own image has 8 bits
    green = 127 / 255 if "image" in look else 0.5
    np.testing.assert_allclose(renderer.rgb[2, 2], [1, linear(green), 0], rtol=1e-6)
