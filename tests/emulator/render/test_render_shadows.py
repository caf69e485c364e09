"""Shadows against MuJoCo's own rays, from what is seen to the lamp."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from evs.emulator.base.scene import CameraModel
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene

pytestmark = pytest.mark.property

SHADOWS = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset><mesh name="wedge" vertex="0 0 0  .5 0 0  0 .5 0  0 0 .5  .3 .3 .3"/></asset>
  <worldbody>
    <light type="{kind}" pos="{x} {y} 3" dir="{dx} {dy} -1" cutoff="80" exponent="0"
      diffuse="1 1 1" ambient=".1 .1 .1" specular="0 0 0"/>
    <geom type="plane" size="4 4 .1"/>
    <geom type="sphere" size=".3" pos="-.8 0 .9"/>
    <geom type="capsule" size=".1 .3" pos="-.2 .6 .5" euler="30 60 10"/>
    <geom type="cylinder" size=".2 .15" pos=".3 -.5 .7" euler="70 10 0"/>
    <geom type="ellipsoid" size=".4 .15 .25" pos=".6 .5 1.1" euler="20 50 80"/>
    <geom type="box" size=".2 .3 .1" pos="-.6 -.8 .6" euler="15 25 35"/>
    <geom type="mesh" mesh="wedge" pos=".9 -.2 .5" euler="10 80 30"/>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
@pytest.mark.parametrize("seed", range(3))
def test_shadows_lie_where_mujocos_rays_are_stopped(
    kind: str, seed: int, camera_rays: Callable[[CameraModel], np.ndarray]
) -> None:
    rng = np.random.default_rng(seed)
    x, y, dx, dy = rng.uniform(-0.6, 0.6, 4)
    model = mujoco.MjModel.from_xml_string(SHADOWS.format(kind=kind, x=x, y=y, dx=dx, dy=dy))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    width, height = 80, 60
    view = CameraConfig(lookat=(0, 0, 0.4), distance=4.0, elevation=-40, azimuth=120 * seed)
    bound = bind_camera(model, "", width, height, view)
    shot = SnapshotTaker(model, [bound]).snapshot(data, 0)
    pose, scene = shot.cameras[0], extract_scene(model)
    lit, unshadowed = (
        NativeRenderer(scene, bound.model, RenderConfig(spp=1, shadows=shadows), 1)
        for shadows in (True, False)
    )
    index, distance = lit.hits(shot, pose)
    dark = lit.render(shot, pose) < unshadowed.render(shot, pose)
    # each hit point, from where it is seen, and MuJoCo's own ray from there to the lamp
    d = camera_rays(bound.model) @ pose.mat.reshape(3, 3).T
    points = pose.pos + d * distance[..., np.newaxis]
    stopped = np.zeros((height, width), bool)
    for row, column in np.argwhere(index >= 0):
        # a millimetre back along the view: off the surface that is seen
        start = points[row, column] - d[row, column] * 1e-3
        towards = -shot.light_dir[0] * 1e3 if kind == "directional" else shot.light_pos[0] - start
        hit = np.zeros(1, np.int32)
        share = mujoco.mj_ray(model, data, start, towards, None, 1, -1, hit)
        stopped[row, column] = 0 <= share < 1
    # pixels whose neighbours agree, and that the lamp lights at all without shadows
    ambient = 0.1 * float(((0.5 + 0.055) / 1.055) ** 2.4)
    faces_lamp = unshadowed.render(shot, pose) > 1.5 * ambient

    def calm(picture: np.ndarray) -> np.ndarray:
        inner = np.zeros((height, width), bool)
        windows = np.lib.stride_tricks.sliding_window_view(picture, (3, 3))
        inner[1:-1, 1:-1] = (windows == windows[..., 1:2, 1:2]).all((-1, -2))
        return inner

    clear = calm(index) & calm(stopped) & calm(dark) & faces_lamp & (index >= 0)
    assert clear.sum() > 1500
    assert dark[clear].sum() > 15
    np.testing.assert_array_equal(dark[clear], stopped[clear])
