"""Through transparent surfaces: front to back, each once, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.config import CameraConfig
from reference.closed_forms import linear
from reference.instants import Film
from reference.scenes import SAMPLED_OUTLINES

GLOW = '<material name="{0}" emission="1" specular="0" rgba="{1} {1} {1} {2}"/>'


def panes(*layers: tuple[float, float, float], more: str = "") -> str:
    """Glowing boxes (height above the floor, grey, alpha) under a camera that looks down."""
    materials = "".join(GLOW.format(f"m{i}", g, a) for i, (_, g, a) in enumerate(layers))
    boxes = "".join(
        f'<geom type="box" size="1 1 .05" pos="0 0 {z}" material="m{i}"/>'
        for i, (z, _, _) in enumerate(layers)
    )
    return f"""<mujoco><visual><headlight active="0"/></visual><asset>{materials}
        {more}</asset><worldbody><camera pos="0 0 5" fovy="10"/>{boxes}</worldbody></mujoco>"""


def seen(xml: str, isa: str = "auto") -> tuple[np.ndarray, np.ndarray]:
    """Luminance, and index of what is hit first."""
    film = Film(xml, (8, 8))
    renderer, instant = film.renderer(isa=isa), (film.shot, film.shot.cameras[0])
    return renderer.render(*instant).astype(float), renderer.hits(*instant)[0]


@pytest.mark.parametrize("isa", _core.isa_available())
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_layers_blend_front_to_back_in_any_order_of_the_model(order, isa) -> None:
    layers = [(0.0, 1.0, 1.0), (1.0, 0.5, 0.25), (2.0, 0.8, 0.5)]
    light, first = seen(panes(*(layers[i] for i in order)), isa)
    expected = 0.5 * linear(0.8) + 0.5 * (0.25 * linear(0.5) + 0.75 * 1.0)
    np.testing.assert_allclose(light, expected, rtol=1e-5)
    # the nearest pane is what a ray hits, transparent or not
    assert (first == order.index(2)).all()


def test_behind_the_last_pane_is_the_sky() -> None:
    sky = """<texture type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="8"
        height="8"/>"""
    light, _ = seen(panes((1.0, 0.5, 0.25), more=sky))
    np.testing.assert_allclose(light, 0.25 * linear(0.5) + 0.75, rtol=1e-5)


def test_seven_panes_are_seen_and_not_forgotten() -> None:
    layers = [(0.3 * i, 1.0, 0.5) for i in range(7)]
    light, _ = seen(panes(*layers))
    np.testing.assert_allclose(light, 1 - 0.5**7, rtol=1e-5)


def test_a_transparent_mirror_is_no_mirror() -> None:
    # as in MuJoCo's viewer
    xml = """<mujoco><visual><headlight active="0"/></visual><asset>
        <material name="glow" emission="1" specular="0" rgba="1 1 1 1"/>
        <material name="m" reflectance=".5" specular="0" rgba="0 0 0 {}"/></asset><worldbody>
        <camera pos="0 -3 1" xyaxes="1 0 0 0 .3 .95"/>
        <geom type="plane" size="9 9 .1" material="m"/>
        <geom type="sphere" size=".4" pos="0 0 1" material="glow"/></worldbody></mujoco>"""
    for alpha, values in ((1.0, [0, 0.5, 1]), (0.5, [0, 1])):
        light = Film(xml.format(alpha), (48, 48)).light(switches=SAMPLED_OUTLINES)
        np.testing.assert_allclose(np.unique(light), values, atol=1e-6)


def test_what_moves_behind_glass_is_traced_again() -> None:
    xml = """
      <mujoco><option timestep=".001" gravity="0 0 0"/><asset>
        <mesh name="wedge" vertex="0 0 0  .6 0 0  0 .6 0  0 0 .6"/></asset><worldbody>
        <light type="directional" dir=".2 .3 -1"/><geom type="plane" size="2 2 .1"/>
        <geom type="sphere" size=".4" pos="0 0 .5" rgba=".5 .6 .9 .4"/>
        <geom type="mesh" mesh="wedge" pos="-.8 -.4 .1" rgba=".9 .6 .4 .3"/>
        <body pos="-.9 .2 .3"><freejoint/><geom type="box" size=".1 .1 .1"/>
          <geom type="sphere" size=".1" pos="0 -.4 0" rgba="1 1 1 .5"/></body>
      </worldbody></mujoco>"""
    view = CameraConfig(lookat=(0, 0, 0.3), distance=2.4, azimuth=100, elevation=-20)
    film = Film(xml, (70, 50), view)
    film.data.qvel[:] = (3, 0, 0, 5, 4, 3)
    kept, full = film.renderer(2, spp=2), film.renderer(2, spp=2, incremental=False)
    fractions = []
    for frame in film.snapshots(201)[1:]:
        np.testing.assert_array_equal(
            kept.render(frame, frame.cameras[0]), full.render(frame, frame.cameras[0])
        )
        fractions.append(kept.traced_fraction)
    assert np.mean(fractions[1:]) < 0.7
