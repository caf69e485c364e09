"""What the rays hit, against MuJoCo's own ray casting (mj_multiRay) on real robots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.base.scene import CameraModel
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene, load_model
from reference.instants import Film

Rays = Callable[[CameraModel], np.ndarray]

WIDTH, HEIGHT = 173, 130
MODELS = [
    "gymnasium/ant",
    "gymnasium/half_cheetah",
    "gymnasium/humanoid",
    "gymnasium/pusher_v5",
    "gymnasium/reacher",
    "dm_control/finger",
    "dm_control/humanoid",
    "dm_control/humanoid_CMU",
    "dm_control/manipulator",
    "dm_control/walker",
]

SHAPES = """
<mujoco>
  <asset>
    <hfield name="hills" nrow="9" ncol="7" size="1.5 1 .6 .2"
     elevation="0 1 2 1 0 3 1  1 5 2 0 1 1 2  0 1 2 4 1 0 1  2 1 0 1 1 3 0  0 4 1 2 0 1 1
                1 0 2 1 5 1 0  1 2 1 0 1 1 2  0 1 3 1 2 0 1  2 0 1 1 0 2 1"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1  .6 .6 .6"/>
  </asset>
  <worldbody>
    <geom type="plane" size="0 0 .1" pos="0 0 -1"/>
    <geom type="plane" size=".6 .4 .1" pos="0 -1.4 .2" euler="40 20 0"/>
    <geom type="hfield" hfield="hills" pos="0 2.2 -.8"/>
    <geom type="mesh" mesh="wedge" pos="1 .4 .2" euler="10 80 30"/>
    <geom type="sphere" size=".3" pos="-1 0 0"/>
    <geom type="capsule" size=".12 .4" pos="-.4 .4 .2" euler="30 60 10"/>
    <geom type="cylinder" size=".25 .2" pos=".3 -.5 .1" euler="70 10 0"/>
    <geom type="ellipsoid" size=".4 .15 .25" pos=".4 .5 .6" euler="20 50 80"/>
    <geom type="box" size=".2 .3 .1" pos="-.6 -.6 -.3" euler="15 25 35"/>
  </worldbody>
</mujoco>
"""


def agreement(
    model: mujoco.MjModel, view: CameraConfig, ticks: int, camera_rays: Rays
) -> tuple[float, np.ndarray]:
    """Share of pixels with the same geom and depth, and the mask of the others (h, w)."""
    data = mujoco.MjData(model)
    model.opt.timestep = 1e-3
    for _ in range(ticks):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    scene = extract_scene(model)
    bound = bind_camera(model, "", WIDTH, HEIGHT, view)
    snapshot = SnapshotTaker(model, [bound]).snapshot(data, 0)
    pose = snapshot.cameras[0]
    # MuJoCo's rays pass through sites
    renderer = NativeRenderer(scene, bound.model, RenderConfig(spp=4, sites=False), 1)
    index, distance = renderer.hits(snapshot, pose)
    ours = np.where(index >= 0, scene.geom_id[index], -1).reshape(-1)

    rays = camera_rays(bound.model).reshape(-1, 3) @ pose.mat.reshape(3, 3).T
    theirs, depth = np.zeros(len(rays), np.int32), np.zeros(len(rays))
    normals = np.zeros((len(rays), 3))
    groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    mujoco.mj_multiRay(
        model, data, pose.pos, np.ascontiguousarray(rays).ravel(), groups, 1, -1, theirs, depth,
        normals.reshape(-1), len(rays), mujoco.mjMAXVAL,
    )  # fmt: skip
    same = ours == theirs
    near = np.abs(distance.reshape(-1) - depth) <= 1e-3 * np.maximum(depth, 0.01)
    return float(np.mean(same & (near | (theirs < 0)))), ~(same & near).reshape(HEIGHT, WIDTH)


@pytest.mark.parametrize("name", MODELS)
def test_hits_agree_with_mujoco(name: str, robot_files: dict[str, Path], camera_rays: Rays) -> None:
    share, _ = agreement(load_model(robot_files[name]), CameraConfig(), 20, camera_rays)
    assert share >= 0.995


@pytest.mark.parametrize("azimuth", range(0, 360, 45))
def test_every_shape_agrees_with_mujoco(azimuth: int, camera_rays: Rays) -> None:
    view = CameraConfig(lookat=(0, 0, 0), distance=4.5, azimuth=azimuth, elevation=-25)
    share, wrong = agreement(mujoco.MjModel.from_xml_string(SHAPES), view, 0, camera_rays)
    # what differs is silhouettes: single pixels, never an area
    assert share >= 0.995
    area = wrong[:-1, :-1] & wrong[1:, :-1] & wrong[:-1, 1:] & wrong[1:, 1:]
    assert not area.any()


def test_orthographic_depth_is_exact() -> None:
    xml = """
      <mujoco><worldbody>
        <camera name="above" pos="0 0 3" projection="orthographic" fovy="2"/>
        <geom type="box" size=".5 .25 .5"/>
      </worldbody></mujoco>"""
    film = Film(xml, (40, 40))
    index, distance = film.renderer().hits(film.shot, film.shot.cameras[0])
    # 20 px a m: the lid is 20 x 10 px in the middle, 2.5 m below the camera
    expected = np.full((40, 40), -1)
    expected[15:25, 10:30] = 0
    np.testing.assert_array_equal(index, expected)
    np.testing.assert_allclose(distance[index == 0], 2.5, rtol=1e-6)


def test_a_camera_inside_a_shape_sees_through_it() -> None:
    xml = """
      <mujoco><worldbody>
        <camera name="eye" pos="0 0 0" xyaxes="1 0 0 0 0 1"/>
        <geom type="sphere" size=".3"/>
        <geom type="box" size="5 .1 5" pos="0 2 0"/>
      </worldbody></mujoco>"""
    film = Film(xml, (16, 16))
    index, _ = film.renderer().hits(film.shot, film.shot.cameras[0])
    assert (index == 1).all()
