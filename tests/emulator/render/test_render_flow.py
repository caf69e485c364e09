"""Optical flow against finite differences of projected points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.base.scene import CameraModel, CameraPose, GroundTruth, SceneSnapshot
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene, load_model
from evs.msgs import EvsError

Rays = Callable[[CameraModel], np.ndarray]

WIDTH, HEIGHT = 64, 48
TICK_US = 1000

SCENE = """
<mujoco>
  <option gravity="0 0 0" timestep=".001"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 .1"/>
    <body name="ball" pos="0 0 .6"><freejoint/>
      <geom name="ball" type="sphere" size=".3"/>
      <geom name="arm" type="box" size=".4 .05 .05" pos=".3 0 .3" euler="10 20 30"/>
    </body>
  </worldbody>
</mujoco>"""
VIEW = CameraConfig(lookat=(0.1, 0, 0.4), distance=2.5, azimuth=110, elevation=-15)


def pixel_of(camera: CameraModel, pose: CameraPose, points: np.ndarray) -> np.ndarray:
    """(..., 2) px of points in the world; an independent pinhole."""
    x, y, z = np.moveaxis((points - pose.pos) @ pose.mat.reshape(3, 3), -1, 0)
    if camera.orthographic:
        z = -np.ones_like(z)
    return np.stack([camera.cx - camera.fx * x / z, camera.cy + camera.fy * y / z], -1)


class Stage:
    """A model, a camera, and two instants of them one tick apart."""

    def __init__(self, model: mujoco.MjModel, view: CameraConfig, name: str = "") -> None:
        self.model = model
        self.bound = bind_camera(model, name, WIDTH, HEIGHT, view)
        self.camera = self.bound.model
        self.poser = SnapshotTaker(model, [self.bound])
        self.scene = extract_scene(model)
        self.data = mujoco.MjData(model)
        self.renderer = NativeRenderer(self.scene, self.camera, RenderConfig(spp=1), 1)

    def shot(self, t_us: int) -> SceneSnapshot:
        return self.poser.snapshot(self.data, t_us)

    def truth(
        self,
        before: SceneSnapshot,
        now: SceneSnapshot,
        poses: tuple[CameraPose, CameraPose] | None = None,
    ) -> GroundTruth:
        """Poses: of the camera, before and now; None: the snapshots'."""
        first, second = poses or (before.cameras[0], now.cameras[0])
        return self.renderer.ground_truth(now, second, (before, first))


def of_bodies(
    stage: Stage, truth: GroundTruth, before: SceneSnapshot, now: SceneSnapshot,
    poses: tuple[CameraPose, CameraPose],
) -> np.ndarray:  # fmt: skip
    """(h, w, 2) what the flow should be, from the hit points and MuJoCo's geom poses."""
    row = {int(geom): k for k, geom in enumerate(stage.scene.geom_id)}
    expected = np.full((*truth.geom_id.shape, 2), np.nan)
    points = truth.position.astype(float)
    for geom in set(np.unique(truth.geom_id)) - {-1}:
        here, k = truth.geom_id == geom, row[int(geom)]
        local = (points[here] - now.geom_pos[k]) @ now.geom_mat[k].reshape(3, 3)
        was = local @ before.geom_mat[k].reshape(3, 3).T + before.geom_pos[k]
        here_now = pixel_of(stage.camera, poses[1], points[here])
        expected[here] = here_now - pixel_of(stage.camera, poses[0], was)
    return expected / ((now.t_us - before.t_us) * 1e-6)


def turned(pose: CameraPose, axis: list[float], angle: float, shift: list[float]) -> CameraPose:
    """A camera a little further."""
    quat, turn = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quat, np.array(axis, float), angle)
    mujoco.mju_quat2Mat(turn, quat)
    mat = turn.reshape(3, 3) @ pose.mat.reshape(3, 3)
    return CameraPose(pose.pos + np.array(shift), mat.ravel())


@pytest.mark.parametrize(
    ("velocity", "spin", "turn", "shift"),
    [
        ((0.5, -1.0, 2.0), (0, 0, 0), 0.0, [0, 0, 0]),
        ((0, 0, 0), (3.0, -8.0, 5.0), 0.0, [0, 0, 0]),
        ((0, 0, 0), (0, 0, 0), 2e-3, [0, 0, 0]),
        ((0, 0, 0), (0, 0, 0), 0.0, [1e-3, -2e-3, 1.5e-3]),
        ((0.3, 0.2, -1.0), (4.0, 1.0, -6.0), -1e-3, [2e-3, 1e-3, -1e-3]),
    ],
    ids=["moving body", "spinning body", "panning camera", "translating camera", "everything"],
)
def test_flow_is_the_finite_difference_of_projected_points(
    velocity: tuple[float, ...], spin: tuple[float, ...], turn: float, shift: list[float]
) -> None:
    stage = Stage(mujoco.MjModel.from_xml_string(SCENE), VIEW)
    before = stage.shot(0)
    stage.data.qvel[:] = (*velocity, *spin)
    mujoco.mj_integratePos(stage.model, stage.data.qpos, stage.data.qvel, TICK_US * 1e-6)
    now = stage.shot(TICK_US)
    poses = before.cameras[0], turned(now.cameras[0], [0.2, 0.5, 1], turn, shift)
    truth = stage.truth(before, now, poses)
    hit = truth.geom_id >= 0
    assert set(np.unique(truth.geom_id)) >= {0, 1, 2}
    expected = of_bodies(stage, truth, before, now, poses)
    # positions are float32: 1e-6 m at 2 m is 5e-5 px, in 1 ms
    np.testing.assert_allclose(truth.flow[hit], expected[hit], atol=0.15, rtol=1e-5)
    moves = any(velocity) or any(spin)
    assert np.abs(truth.flow[truth.geom_id == 1]).max() > 10 or not (moves or turn or any(shift))
    if not turn and not any(shift):
        assert (truth.flow[(truth.geom_id == 0) | ~hit] == 0).all()


def test_a_sphere_that_flies_sideways_has_the_closed_form(camera_rays: Rays) -> None:
    # camera looks along -z from above, so image velocity is f v / depth of the point that is seen
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody>
        <camera name="above" pos="0 0 3" fovy="40"/>
        <body name="ball" mocap="true"><geom type="sphere" size=".5"/></body>
      </worldbody></mujoco>""")
    stage = Stage(model, CameraConfig(), "above")
    before = stage.shot(0)
    stage.data.mocap_pos[0] = (2e-3, 1e-3, 0)
    truth = stage.truth(before, stage.shot(TICK_US))
    hit = truth.geom_id == 0
    assert hit.sum() > 300
    # 2 m/s to the right, 1 m/s up: y of the image goes down
    expected = stage.camera.fx * np.array([2.0, -1.0]) / truth.depth[hit][:, np.newaxis]
    np.testing.assert_allclose(truth.flow[hit], expected, rtol=2e-5, atol=0.05)
    # and the depth is the sphere's own
    d = camera_rays(stage.camera)[hit]
    centre = np.array([2e-3, 1e-3, -3.0])
    b = d @ centre
    t = b - np.sqrt(b**2 - centre @ centre + 0.25)
    np.testing.assert_allclose(truth.depth[hit], -t * d[:, 2], rtol=1e-5)
    assert (truth.flow[~hit] == 0).all()


def test_what_lies_at_infinity_moves_with_the_cameras_turn_alone(camera_rays: Rays) -> None:
    stage = Stage(mujoco.MjModel.from_xml_string(SCENE), VIEW)
    shots = stage.shot(0), stage.shot(TICK_US)
    rest = shots[0].cameras[0]
    pan = turned(rest, [0, 0, 1], 1e-3, [0.3, 0, 0])
    truth = stage.truth(*shots, (rest, pan))
    sky = truth.geom_id == -1
    assert sky.sum() > 200
    far = pan.pos + 1e9 * (camera_rays(stage.camera)[sky] @ pan.mat.reshape(3, 3).T)
    at_rest = CameraPose(pan.pos, rest.mat)
    moved = pixel_of(stage.camera, pan, far) - pixel_of(stage.camera, at_rest, far)
    np.testing.assert_allclose(truth.flow[sky], moved / 1e-3, rtol=1e-4, atol=0.02)
    # a turn to the left moves the picture to the right
    assert (truth.flow[sky][:, 0] > 0).all()


def test_an_orthographic_camera_sees_flow_without_depth() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody>
        <camera name="above" pos="0 0 3" projection="orthographic" fovy="2"/>
        <body name="ball" mocap="true"><geom type="sphere" size=".5"/></body>
      </worldbody></mujoco>""")
    stage = Stage(model, CameraConfig(), "above")
    before = stage.shot(0)
    stage.data.mocap_pos[0] = (1e-3, -2e-3, 0.5)
    now = stage.shot(TICK_US)
    pan = turned(now.cameras[0], [0, 1, 0], 0.01, [0, 0, 0])
    truth = stage.truth(before, now)
    hit = truth.geom_id == 0
    expected = np.array([1.0, 2.0]) * stage.camera.fx
    np.testing.assert_allclose(truth.flow[hit], [expected] * hit.sum(), rtol=1e-5, atol=0.05)
    turning = stage.truth(before, now, (before.cameras[0], pan))
    assert (turning.flow[turning.geom_id == -1] == 0).all()


def test_a_cloth_flows_with_its_triangles() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><option timestep=".001"/><worldbody>
        <geom type="plane" size="2 2 .1"/>
        <flexcomp name="cloth" type="grid" count="6 6 1" spacing=".1 .1 .1" radius=".01" dim="2"
          pos="0 0 .5" mass="1"/>
      </worldbody></mujoco>""")
    view = CameraConfig(lookat=(0, 0, 0.4), distance=1.2, azimuth=80, elevation=-50)
    stage = Stage(model, view)
    before = stage.shot(0)
    rng = np.random.default_rng(4)
    stage.data.qpos[:] += rng.normal(size=model.nq) * 2e-3
    now = stage.shot(TICK_US)
    truth = stage.truth(before, now)
    cloth = truth.geom_id == -2
    assert cloth.sum() > 500
    assert (truth.flow[truth.geom_id == 0] == 0).all()
    # each point by its place in the triangle that it lies in, found again from its position
    faces = stage.scene.meshes[stage.scene.deforming[0]].faces
    corners_now, corners_before = (
        shot.deformed[0].vertices.astype(float)[faces] for shot in (now, before)
    )
    points = truth.position[cloth].astype(float)
    a, b, c = (corners_now[:, k] for k in range(3))
    n = np.cross(b - a, c - a)
    area = np.maximum((n * n).sum(1), 1e-30)
    p = points[:, np.newaxis]
    shares = np.stack([
        (np.cross(c - b, p - b) * n).sum(-1) / area,
        (np.cross(a - c, p - c) * n).sum(-1) / area,
        (np.cross(b - a, p - a) * n).sum(-1) / area,
    ], -1)  # fmt: skip
    off = np.abs(((p - a) * n).sum(-1)) / np.sqrt(area) + np.maximum(-shares.min(-1), 0)
    face = off.argmin(1)
    share = shares[np.arange(len(face)), face]
    was = (share[..., np.newaxis] * corners_before[face]).sum(1)
    pose = now.cameras[0]
    moved = pixel_of(stage.camera, pose, points) - pixel_of(stage.camera, pose, was)
    sure = share.min(-1) > 0.01
    assert sure.mean() > 0.8
    np.testing.assert_allclose(truth.flow[cloth][sure], moved[sure] / 1e-3, rtol=1e-3, atol=1.0)
    assert np.abs(truth.flow[cloth]).max() > 100


def test_what_was_behind_the_camera_has_no_flow() -> None:
    stage = Stage(mujoco.MjModel.from_xml_string(SCENE), VIEW)
    shots = stage.shot(0), stage.shot(TICK_US)
    rest = shots[0].cameras[0]
    about = turned(rest, [0, 0, 1], np.pi, [0, 0, 0])
    truth = stage.truth(*shots, (about, rest))
    floor = truth.geom_id == 0
    assert np.isnan(truth.flow[floor]).all()


def test_nothing_moves_while_nothing_moves_and_time_has_to_pass() -> None:
    stage = Stage(mujoco.MjModel.from_xml_string(SCENE), VIEW)
    shots = stage.shot(0), stage.shot(TICK_US)
    assert (stage.truth(*shots).flow == 0).all()
    with pytest.raises(EvsError, match="must be the earlier one"):
        stage.truth(shots[1], replace(shots[1]))


@pytest.mark.slow
def test_a_skin_flows_with_its_bones(robot_files: dict[str, Path]) -> None:
    model = load_model(robot_files["dm_control/dog"])
    stage = Stage(model, CameraConfig(lookat=(0, 0, 0.5), distance=1.6, azimuth=90, elevation=-10))
    before = stage.shot(0)
    # the whole dog moves as one body: every bone, and so the skin, turns and shifts alike
    velocity = np.zeros(model.nv)
    velocity[:6] = (0.5, -1.0, 0.7, 1.0, -2.0, 3.0)
    mujoco.mj_integratePos(model, stage.data.qpos, velocity, TICK_US * 1e-6)
    now = stage.shot(TICK_US)
    truth = stage.truth(before, now)
    skin = truth.geom_id == -2
    assert skin.sum() > 300
    assert (truth.body_id[skin] == -1).all()
    mujoco.mj_kinematics(model, stage.data)
    root = stage.data.body(model.body_rootid[1])
    place, turn = root.xpos.copy(), root.xmat.reshape(3, 3).copy()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    first = data.body(model.body_rootid[1])
    local = (truth.position[skin] - place) @ turn
    was = local @ first.xmat.reshape(3, 3).T + first.xpos
    pose = now.cameras[0]
    moved = pixel_of(stage.camera, pose, truth.position[skin].astype(float))
    moved -= pixel_of(stage.camera, pose, was)
    # vertices are float32: 6e-8 m, 100 px a m, in 1 ms
    np.testing.assert_allclose(truth.flow[skin], moved / 1e-3, rtol=2e-3, atol=0.2)
    assert np.abs(truth.flow[skin]).max() > 50


def test_far_from_the_origin_nothing_is_lost() -> None:
    flows = []
    for away in (0.0, 1e5):
        place = SCENE.replace('pos="0 0 .6"', f'pos="{away} {-away} .6"')
        # the model is so large that MuJoCo's near plane lies behind what is looked at
        view = replace(VIEW, lookat=(0.1 + away, -away, 0.4), near_m=0.0)
        stage = Stage(mujoco.MjModel.from_xml_string(place), view)
        before = stage.shot(0)
        stage.data.qvel[:] = (0.3, 0.2, -1.0, 4.0, 1.0, -6.0)
        mujoco.mj_integratePos(stage.model, stage.data.qpos, stage.data.qvel, TICK_US * 1e-6)
        now = stage.shot(TICK_US)
        turn = turned(now.cameras[0], [0.2, 0.5, 1], 1e-3, [2e-3, 1e-3, -1e-3])
        flows.append(stage.truth(before, now, (before.cameras[0], turn)).flow)
    near, far = flows
    away = np.abs(near - far).max(-1)
    # a double is right to 1.5e-11 m there: 1e-6 px in 1 ms; pixels of the rim may see another geom
    assert (away < 0.01 + 1e-4 * np.abs(near).max()).mean() > 0.995
