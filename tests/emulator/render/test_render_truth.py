"""Ground truth of one instant: closed forms, MuJoCo's rays, and the same bytes everywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import CameraModel, CameraPose, GroundTruth
from evs.emulator.config import CameraConfig
from evs.emulator.world import BoundCamera, extract_scene
from reference.instants import Film

Rays = Callable[[CameraModel], np.ndarray]

WIDTH, HEIGHT = 61, 47

SPHERE = """
<mujoco><worldbody>
  <geom name="floor" type="plane" size="0 0 .1"/>
  <body name="ball" pos=".2 .1 .5"><geom name="ball" type="sphere" size=".4"/></body>
</worldbody></mujoco>"""
VIEW = CameraConfig(lookat=(0.1, 0, 0.3), distance=2.5, azimuth=130, elevation=-20)


def truth_of(
    model: mujoco.MjModel, view: CameraConfig = VIEW, **render: object
) -> tuple[GroundTruth, BoundCamera, CameraPose]:
    """What is true of a model at rest."""
    film = Film(model, (WIDTH, HEIGHT), view)
    shot = replace(film.shot, t_us=7000)
    truth = film.renderer(2, **{"spp": 4, **render}).ground_truth(shot, shot.cameras[0])
    return truth, film.bound, shot.cameras[0]


def test_a_plane_and_a_sphere_have_their_closed_forms(camera_rays: Rays) -> None:
    truth, bound, pose = truth_of(mujoco.MjModel.from_xml_string(SPHERE))
    d = camera_rays(bound.model) @ pose.mat.reshape(3, 3).T
    centre = np.array([0.2, 0.1, 0.5])
    # the sphere: |o + t d - c| = r
    b = d @ (pose.pos - centre)
    root = b**2 - ((pose.pos - centre) ** 2).sum() + 0.4**2
    ball = root > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        t_ball = -b - np.sqrt(root)
        t_floor = -pose.pos[2] / d[..., 2]
    floor = ~ball & (t_floor > 0)
    nothing = ~ball & ~floor
    assert min(ball.sum(), floor.sum(), nothing.sum()) > 100
    rim = np.abs(root) < 1e-4
    assert rim.mean() < 0.01
    ball, floor, nothing = ball & ~rim, floor & ~rim, nothing & ~rim

    assert truth.t_us == 7000
    np.testing.assert_array_equal(truth.geom_id[ball], 1)
    np.testing.assert_array_equal(truth.geom_id[floor], 0)
    np.testing.assert_array_equal(truth.geom_id[nothing], -1)
    np.testing.assert_array_equal(truth.body_id[ball], 1)
    np.testing.assert_array_equal(truth.body_id[floor], 0)
    np.testing.assert_array_equal(truth.body_id[nothing], -1)
    np.testing.assert_allclose(truth.distance[ball], t_ball[ball], rtol=1e-5)
    np.testing.assert_allclose(truth.distance[floor], t_floor[floor], rtol=1e-5)
    # along the optical axis, which is the camera's -z
    axis = -pose.mat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(truth.depth[floor], (t_floor * (d @ axis))[floor], rtol=1e-5)
    point = pose.pos + d * np.where(ball, t_ball, t_floor)[..., np.newaxis]
    seen = ball | floor
    off = np.linalg.norm(truth.position - point, axis=-1)[seen]
    # a direction is right to 6e-8, which a grazing ray of 0.01 rad turns into 6e-6 of its length
    assert (off <= 1e-5 * truth.distance[seen]).all()
    np.testing.assert_allclose(truth.normal[floor], [[0, 0, 1]] * floor.sum(), atol=1e-6)
    out = (point - centre) / 0.4
    np.testing.assert_allclose(truth.normal[ball], out[ball], atol=2e-5)
    for values in (truth.depth, truth.distance):
        assert (values[nothing] == np.inf).all()
    for values in (truth.normal, truth.position, truth.flow):
        assert np.isnan(values[nothing]).all()
    assert np.isnan(truth.flow).all()


def test_types_and_shapes() -> None:
    truth, _, _ = truth_of(mujoco.MjModel.from_xml_string(SPHERE))
    for name, shape, dtype in (
        ("depth", (), np.float32),
        ("distance", (), np.float32),
        ("normal", (3,), np.float32),
        ("position", (3,), np.float32),
        ("geom_id", (), np.int32),
        ("body_id", (), np.int32),
        ("flow", (2,), np.float32),
    ):
        values = getattr(truth, name)
        assert values.shape == (HEIGHT, WIDTH, *shape)
        assert values.dtype == dtype


def test_an_orthographic_camera_has_depth_along_its_axis() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody>
        <camera name="above" pos="0 0 3" projection="orthographic" fovy="2"/>
        <geom type="box" size=".5 .25 .5"/>
        <geom type="box" size=".1 .1 .1" pos="-.7 .7 1" euler="0 30 0"/>
      </worldbody></mujoco>""")
    truth, _, _ = truth_of(model, CameraConfig())
    lid = truth.geom_id == 0
    assert lid.sum() > 100
    np.testing.assert_allclose(truth.depth[lid], 2.5, rtol=1e-6)
    np.testing.assert_allclose(truth.distance, truth.depth)
    np.testing.assert_allclose(truth.normal[lid], [[0, 0, 1]] * lid.sum(), atol=1e-6)
    tilted = truth.geom_id == 1
    np.testing.assert_allclose(np.abs(truth.normal[tilted][:, 0]).min(), 0.5, atol=1e-5)


def test_a_mesh_has_smooth_normals_turned_to_the_camera() -> None:
    # an octahedron with MuJoCo's own vertex normals, against the blend of the corners
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><asset>
        <mesh name="m" vertex="1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1" smoothnormal="true"/>
      </asset><worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>""")
    view = CameraConfig(lookat=(0, 0, 0), distance=4, azimuth=20, elevation=-30)
    truth, _, pose = truth_of(model, view)
    seen = truth.geom_id == 0
    assert seen.sum() > 200
    mesh = extract_scene(model).meshes[0]
    assert mesh.normals is not None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    turn = data.geom_xmat[0].reshape(3, 3)
    local = (truth.position[seen] - data.geom_xpos[0]) @ turn
    # barycentric shares of the face that each point lies on, by areas
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    n = np.cross(b - a, c - a)
    area = (n * n).sum(1)
    p = local[:, np.newaxis]
    shares = np.stack([
        (np.cross(c - b, p - b) * n).sum(-1) / area,
        (np.cross(a - c, p - c) * n).sum(-1) / area,
        (np.cross(b - a, p - a) * n).sum(-1) / area,
    ], -1)  # fmt: skip
    off = np.abs(((p - a) * n).sum(-1)) / np.sqrt(area) + 10 * np.maximum(-shares.min(-1), 0)
    face = off.argmin(1)
    inside = shares[np.arange(len(face)), face].min(-1) > 0.02
    expected = (shares[np.arange(len(face)), face, :, np.newaxis] * mesh.normals[face]).sum(1)
    expected = expected / np.linalg.norm(expected, axis=1, keepdims=True) @ turn.T
    towards = pose.pos - truth.position[seen]
    expected *= np.sign((expected * towards).sum(1, keepdims=True))
    assert inside.sum() > 150
    np.testing.assert_allclose(truth.normal[seen][inside], expected[inside], atol=2e-4)
    assert ((truth.normal[seen] * towards).sum(1) >= 0).all()


def test_transparent_surfaces_count_and_skins_and_flexes_have_numbers() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody>
        <geom type="plane" size="0 0 .1"/>
        <geom type="box" size=".3 .3 .01" pos="0 0 .8" rgba="1 1 1 .2"/>
        <body name="hidden"><geom size=".1" group="4"/></body>
        <flexcomp name="cloth" type="grid" count="4 4 1" spacing=".2 .2 .2" radius=".01" dim="2"
          pos="1 0 .5" mass="1"/>
      </worldbody></mujoco>""")
    view = CameraConfig(lookat=(0.5, 0, 0), distance=3, azimuth=90, elevation=-89)
    truth, _, _ = truth_of(model, view)
    assert set(np.unique(truth.geom_id)) == {0, 1, -2}
    assert set(np.unique(truth.body_id)) == {0, -1}
    np.testing.assert_allclose(truth.position[truth.geom_id == 1][:, 2], 0.81, atol=1e-5)


@pytest.mark.parametrize("isa", _core.isa_available())
def test_every_instruction_set_and_thread_count_tells_the_same_truth(isa: str) -> None:
    model = mujoco.MjModel.from_xml_string(SPHERE)
    first, _, _ = truth_of(model, isa="portable")
    other, _, _ = truth_of(model, isa=isa)
    for name in ("depth", "distance", "normal", "position", "geom_id", "body_id"):
        assert getattr(first, name).tobytes() == getattr(other, name).tobytes(), name


def test_the_light_after_it_is_as_without_it() -> None:
    falling = SPHERE.replace('<geom name="ball"', '<freejoint/><geom name="ball"')
    film = Film(falling, (WIDTH, HEIGHT), VIEW)
    asked, plain = film.renderer(spp=None), film.renderer(spp=None)
    for k, shot in enumerate(film.snapshots(20)):
        pose = shot.cameras[0]
        if k % 3 == 0:
            asked.ground_truth(shot, pose)
        asked_light = asked.render(shot, pose)
        asked.ground_truth(replace(shot, geom_pos=shot.geom_pos + 0.1), pose)
        np.testing.assert_array_equal(asked_light, plain.render(shot, pose))
    assert asked.traced_fraction == plain.traced_fraction < 1


SHAPES = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 .1" pos="0 0 -1"/>
    <geom type="plane" size=".6 .4 .1" pos="0 -1.4 .2" euler="40 20 0"/>
    <geom type="sphere" size=".3" pos="-1 0 0"/>
    <body pos=".1 .1 0">
      <geom type="capsule" size=".12 .4" pos="-.4 .4 .2" euler="30 60 10"/>
      <geom type="cylinder" size=".25 .2" pos=".3 -.5 .1" euler="70 10 0"/>
    </body>
    <geom type="ellipsoid" size=".4 .15 .25" pos=".4 .5 .6" euler="20 50 80"/>
    <geom type="box" size=".2 .3 .1" pos="-.6 -.6 -.3" euler="15 25 35"/>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize("azimuth", [0, 100, 220])
def test_ids_distances_and_normals_are_those_of_mujocos_rays(
    azimuth: int, camera_rays: Rays
) -> None:
    model = mujoco.MjModel.from_xml_string(SHAPES)
    view = CameraConfig(lookat=(0, 0, 0), distance=4, azimuth=azimuth, elevation=-25)
    truth, bound, pose = truth_of(model, view)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rays = camera_rays(bound.model).reshape(-1, 3) @ pose.mat.reshape(3, 3).T
    ids, depth, normals = (
        np.zeros(len(rays), np.int32),
        np.zeros(len(rays)),
        np.zeros(3 * len(rays)),
    )
    mujoco.mj_multiRay(
        model, data, pose.pos, np.ascontiguousarray(rays).ravel(), None, 1, -1, ids, depth, normals,
        len(rays), mujoco.mjMAXVAL,
    )  # fmt: skip
    ids, normals = ids.reshape(HEIGHT, WIDTH), normals.reshape(HEIGHT, WIDTH, 3)
    same = truth.geom_id == ids
    assert same.mean() > 0.995
    hit = same & (ids >= 0)
    np.testing.assert_array_equal(truth.body_id[hit], model.geom_bodyid[ids[hit]])
    np.testing.assert_allclose(truth.distance[hit], depth.reshape(HEIGHT, WIDTH)[hit], rtol=1e-4)
    # MuJoCo's point outwards, ours to the camera: the same, but for planes seen from below
    facing = np.sign((normals * -rays.reshape(HEIGHT, WIDTH, 3)).sum(-1))[..., np.newaxis]
    away = np.linalg.norm(truth.normal - normals * facing, axis=-1)[hit]
    # a hit on an edge may be either side's
    assert (away < 1e-3).mean() > 0.998
