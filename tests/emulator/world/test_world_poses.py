"""Snapshots: poses at t_k belong to the state at t_k, and own their memory."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.world import (
    Physics,
    SnapshotTaker,
    UnstableError,
    bind_camera,
    extract_scene,
    load_model,
)
from evs.msgs import EvsError

ROBOTS = (
    "gymnasium/humanoid",
    "gymnasium/pusher_v5",
    "dm_control/quadruped",
    "dm_control/fish",
    "dm_control/dog",
)


def every_camera(model):
    return [bind_camera(model, str(index), 4, 3) for index in range(model.ncam)]


@pytest.mark.parametrize("name", ROBOTS)
def test_poses_after_a_tick_belong_to_the_state_after_it(robot_files, name):
    physics = Physics(load_model(robot_files[name]), 1000)
    model, data = physics.model, physics.data
    poser = SnapshotTaker(model, every_camera(model))
    geoms = extract_scene(model).geom_id
    geoms = geoms[geoms >= 0]  # skins have no pose of their own
    rng = np.random.default_rng(1)
    data.qvel[:] = rng.normal(size=model.nv)
    for _ in range(5):
        data.ctrl[:] = rng.uniform(-1, 1, model.nu)
        physics.advance()
    snapshot = poser.snapshot(data, physics.t_us)
    fresh = mujoco.MjData(model)
    fresh.qpos[:] = data.qpos
    fresh.mocap_pos[:], fresh.mocap_quat[:] = data.mocap_pos, data.mocap_quat
    mujoco.mj_forward(model, fresh)
    assert snapshot.t_us == 5000
    np.testing.assert_array_equal(snapshot.geom_pos[: len(geoms)], fresh.geom_xpos[geoms])
    np.testing.assert_array_equal(snapshot.geom_mat[: len(geoms)], fresh.geom_xmat[geoms])
    for index, pose in enumerate(snapshot.cameras):
        np.testing.assert_array_equal(pose.pos, fresh.cam_xpos[index])
        np.testing.assert_array_equal(pose.mat, fresh.cam_xmat[index])
    rows = [row for row, light in enumerate(extract_scene(model).lights) if not light.headlight]
    np.testing.assert_array_equal(snapshot.light_pos[rows], fresh.light_xpos)
    np.testing.assert_array_equal(snapshot.light_dir[rows], fresh.light_xdir)
    # the live data is one step behind: without the private copy this test would fail
    assert not np.array_equal(data.geom_xpos[geoms], fresh.geom_xpos[geoms])


def test_mocap_bodies_and_what_hangs_on_them_move():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="hand" mocap="true"><geom size=".1"/>
        <camera name="c"/><light name="l"/><body pos="1 0 0"><geom size=".1"/></body></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.mocap_pos[0] = (1, 2, 3)
    data.mocap_quat[0] = (0, 0, 0, 2)
    snapshot = SnapshotTaker(model, every_camera(model)).snapshot(data, 0)
    np.testing.assert_allclose(snapshot.geom_pos, [(1, 2, 3), (0, 2, 3)], atol=1e-12)
    np.testing.assert_allclose(snapshot.cameras[0].pos, (1, 2, 3))
    np.testing.assert_allclose(snapshot.light_pos[-1], (1, 2, 3))


def test_a_snapshot_is_not_changed_by_the_next(robot_files):
    model = load_model(robot_files["gymnasium/humanoid"])
    data = mujoco.MjData(model)
    poser = SnapshotTaker(model, every_camera(model))
    first = poser.snapshot(data, 0)
    parts = [first.geom_pos, first.geom_mat, first.light_pos, first.light_dir]
    parts += [array for pose in first.cameras for array in (pose.pos, pose.mat)]
    before = [part.copy() for part in parts]
    data.qpos[2] += 1.0
    second = poser.snapshot(data, 1000)
    assert not np.array_equal(second.geom_pos, first.geom_pos)
    for part, old in zip(parts, before, strict=True):
        np.testing.assert_array_equal(part, old)
        assert part.dtype == np.float64


def test_sleeping_bodies_have_poses_too():
    xml = """<mujoco><option><flag sleep="{}"/></option><worldbody>
      <geom type="plane" size="2 2 1"/><body pos="1 1 1"><geom size=".1"/></body>
      <body sleep="init" pos="0 0 .1"><freejoint/><geom size=".1" name="asleep"/></body>
      <camera name="c" pos="0 0 5"/></worldbody></mujoco>"""
    asleep, awake = (mujoco.MjModel.from_xml_string(xml.format(f)) for f in ("enable", "disable"))
    data = mujoco.MjData(asleep)
    data.qpos[0] = 0.5
    one = SnapshotTaker(asleep, every_camera(asleep)).snapshot(data, 0)
    two = SnapshotTaker(awake, every_camera(awake)).snapshot(data, 0)
    np.testing.assert_array_equal(one.geom_pos, two.geom_pos)
    np.testing.assert_array_equal(one.cameras[0].pos, two.cameras[0].pos)
    assert one.geom_pos[2].tolist() == [0.5, 0.0, 0.1]
    assert asleep.opt.enableflags == int(mujoco.mjtEnableBit.mjENBL_SLEEP)


def test_the_headlights_row_has_a_unit_direction(robot_files):
    model = load_model(robot_files["gymnasium/humanoid"])
    scene = extract_scene(model)
    snapshot = SnapshotTaker(model).snapshot(mujoco.MjData(model), 0)
    assert scene.lights[0].headlight
    assert snapshot.light_pos.shape == snapshot.light_dir.shape == (len(scene.lights), 3)
    np.testing.assert_allclose(np.linalg.norm(snapshot.light_dir, axis=1), 1.0)


def test_data_of_another_model_is_refused(robot_files):
    models = [load_model(robot_files[f"gymnasium/{name}"]) for name in ("humanoid", "ant")]
    with pytest.raises(EvsError, match="the data belongs to another model: it has 15 positions"):
        SnapshotTaker(models[0]).snapshot(mujoco.MjData(models[1]), 0)


def test_positions_that_are_no_numbers_are_refused(robot_files):
    model = load_model(robot_files["gymnasium/humanoid"])
    data = mujoco.MjData(model)
    data.qpos[9] = np.nan
    with pytest.raises(UnstableError, match=r"bad position .* at joint 'abdomen_x' of body") as e:
        SnapshotTaker(model).snapshot(data, 2500)
    assert "t = 0.002500 s" in str(e.value)
