"""Skins and flexes: their vertices, what rays see of them, and nothing kept that has moved."""

from __future__ import annotations

import subprocess
import sys

import mujoco
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import Shape
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene, load_model

CLOTH = """
<mujoco>
  <option timestep=".001"/>
  <asset>
    <texture name="t" type="2d" builtin="checker" rgb1=".2 .2 .2" rgb2=".9 .9 .9" width="32"
      height="32"/>
    <material name="m" texture="t"/>
  </asset>
  <worldbody>
    <light directional="true" dir=".2 .3 -1"/>
    <geom type="plane" size="2 2 .1"/>
    <geom type="sphere" size=".15" pos="0 0 .15"/>
    <flexcomp name="cloth" type="grid" count="7 7 1" spacing=".08 .08 .08" radius=".01" dim="2"
      pos="0 0 .4" mass="1" rgba=".9 .3 .2 1"><edge equality="true"/></flexcomp>
    <flexcomp name="block" type="grid" count="3 3 3" spacing=".1 .1 .1" radius=".01" dim="3"
      pos=".7 0 .5" mass="1" material="m"><edge equality="true"/></flexcomp>
    <flexcomp name="rope" type="grid" count="5 1 1" spacing=".1 .1 .1" radius=".01" dim="1"
      pos="-.7 0 .5" mass="1"><edge equality="true"/></flexcomp>
  </worldbody>
</mujoco>
"""
VIEW = CameraConfig(lookat=(0.2, 0, 0.2), distance=1.8, azimuth=110, elevation=-25)


@pytest.fixture(scope="module")
def cloth() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(CLOTH)


def test_a_skin_hangs_on_its_bones(robot_files) -> None:
    model = load_model(robot_files["dm_control/dog"])
    data = mujoco.MjData(model)
    data.qpos[7:] = np.random.default_rng(0).uniform(-0.1, 0.1, model.nq - 7)
    (shape,) = SnapshotTaker(model).snapshot(data, 0).deformed
    mujoco.mj_kinematics(model, data)
    expected = np.zeros((model.nskinvert, 3))
    for bone in range(model.nskinbone):
        turn, bind = np.zeros(9), np.zeros(9)
        mujoco.mju_quat2Mat(bind, model.skin_bonebindquat[bone].astype(float))
        mujoco.mju_quat2Mat(turn, data.xquat[model.skin_bonebodyid[bone]])
        turn = turn.reshape(3, 3) @ bind.reshape(3, 3).T
        first, count = model.skin_bonevertadr[bone], model.skin_bonevertnum[bone]
        hung = model.skin_bonevertid[first : first + count]
        weight = model.skin_bonevertweight[first : first + count, np.newaxis]
        local = model.skin_vert[hung] - model.skin_bonebindpos[bone]
        place = data.xpos[model.skin_bonebodyid[bone]]
        np.add.at(expected, hung, weight * (local @ turn.T + place))
    expected += model.skin_inflate[0] * shape.normals
    np.testing.assert_allclose(shape.vertices, expected, atol=1e-5)


def test_cloth_and_block_are_seen_and_a_rope_as_capsules(cloth) -> None:
    scene = extract_scene(cloth)
    assert list(scene.geom_id) == [0, 1, -2, -3, *[-4] * 4]
    assert list(scene.geom_body) == [0, 0, -1, -1, *[-1] * 4]
    assert list(scene.geom_type[2:]) == [Shape.MESH, Shape.MESH, *[Shape.CAPSULE] * 4]
    assert not scene.geom_static[2:].any()
    bound = bind_camera(cloth, "", 80, 60, VIEW)
    snapshot = SnapshotTaker(cloth, [bound]).snapshot(mujoco.MjData(cloth), 0)
    renderer = NativeRenderer(scene, bound.model, RenderConfig(spp=1), 1)
    index, distance = renderer.hits(snapshot, snapshot.cameras[0])
    assert set(np.unique(index)) >= {0, 2, 3, 4, 5, 6, 7}
    assert (distance[index >= 2] > 1).all()
    # rays hit where the vertices are, within half a cell
    eye = snapshot.cameras[0].pos
    for row, shape in zip((2, 3), snapshot.deformed, strict=True):
        nearest = np.linalg.norm(shape.vertices - eye, axis=1).min()
        assert abs(distance[index == row].min() - nearest) < 0.04


def test_faces_out_of_use_hold_nothing(cloth) -> None:
    data = mujoco.MjData(cloth)
    mujoco.mj_forward(cloth, data)
    block = SnapshotTaker(cloth).snapshot(data, 0).deformed[1]
    # 3 x 3 x 3 corners: the 48 faces of the shell are in use, those inside are not
    assert len(block.vertices) > 3 * 48
    assert not block.vertices[3 * 48 :].any()
    assert not block.normals[3 * 48 :].any()
    assert np.isfinite(block.normals).all()
    assert (np.linalg.norm(block.normals[: 3 * 48], axis=1) > 0.99).all()


NEAR = """
import mujoco
from evs.emulator.world import SnapshotTaker, load_model
near, none = (load_model(mujoco.MjModel.from_xml_string({text!r} % z)) for z in ("1e-16", "0.01"))
shapes = [SnapshotTaker(one).snapshot(mujoco.MjData(one), 0).deformed for one in (near, none)]
print([a.vertices.tobytes() == b.vertices.tobytes() for a, b in zip(*shapes, strict=True)])
"""


def test_a_near_clip_plane_of_nothing_does_not_end_the_process() -> None:
    text = CLOTH.replace("<mujoco>", '<mujoco><visual><map znear="%s"/></visual>')
    program = NEAR.format(text=text)
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr, ended.returncode) == ("[True, True]\n", "", 0)


def test_what_deforms_is_traced_again_and_all_machines_agree(cloth) -> None:
    data = mujoco.MjData(cloth)
    bound = bind_camera(cloth, "", 80, 60, VIEW)
    poser, scene = SnapshotTaker(cloth, [bound]), extract_scene(cloth)
    full = NativeRenderer(scene, bound.model, RenderConfig(spp=1, incremental=False), 1)
    others = [
        NativeRenderer(scene, bound.model, RenderConfig(spp=1, isa=isa), 2)
        for isa in _core.isa_available()
    ]
    first = None
    for _ in range(60):
        for _ in range(5):
            mujoco.mj_step(cloth, data)
        frame = poser.snapshot(data, 0)
        light = full.render(frame, frame.cameras[0]).copy()
        for other in others:
            np.testing.assert_array_equal(other.render(frame, frame.cameras[0]), light)
        first = light if first is None else first
    assert others[0].traced_fraction < 0.9
    # the cloth fell: the test has seen something move
    assert np.mean(first != light) > 0.05


def test_a_mesh_takes_only_its_own_number_of_vertices(cloth) -> None:
    scene = extract_scene(cloth)
    bound = bind_camera(cloth, "", 8, 6, VIEW)
    renderer = NativeRenderer(scene, bound.model, RenderConfig(spp=1), 1)
    few = np.zeros((3, 3), np.float32)
    for mesh in (-1, 99):
        with pytest.raises(ValueError, match="does not exist"):
            renderer._caster.deform(mesh, few, few)
    with pytest.raises(ValueError, match="as many vertices"):
        renderer._caster.deform(0, few, few)
