"""Cameras: pixels and poses as MuJoCo's own, and one clear line for what does not exist."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.config import CameraConfig
from evs.emulator.world import ORTHOGRAPHIC, SnapshotTaker, bind_camera, load_model
from evs.msgs import EvsError

MODEL = f"""
<mujoco>
  <statistic extent="4" center="1 2 3"/>
  <visual><global fovy="50" azimuth="100" elevation="-30"/></visual>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <camera name="fixed" pos="0 -3 1" xyaxes="1 0 0 0 .3 1" fovy="40"/>
    <camera name="flat" {ORTHOGRAPHIC} fovy="2" pos="0 0 5"/>
    <camera name="lens" sensorsize=".004 .003" resolution="400 300" focal=".005 .006"
      principal=".0004 -.0002" pos="0 0 3"/>
    <camera name="aim" mode="targetbody" target="arm" pos="2 2 2"/>
    <camera pos="0 0 9"/>
    <body name="arm" pos="0 0 1">
      <joint name="swing" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 1 0 0" size=".1"/>
      <camera name="follow" mode="track" pos="0 -2 0"/>
      <camera name="com" mode="trackcom" pos="0 -2 0"/>
    </body>
  </worldbody>
</mujoco>
"""
WIDTH, HEIGHT = 346, 260


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(MODEL)


@pytest.fixture
def data(model):
    data = mujoco.MjData(model)
    data.qpos[:] = 0.4
    mujoco.mj_forward(model, data)
    return data


def pose_of(model, data, bound):
    (pose,) = SnapshotTaker(model, [bound]).snapshot(data, 0).cameras
    return pose


def mujoco_frustum(model, data, camera):
    """MuJoCo's own eye: (pos, forward, up, frustum slopes left, right, top, bottom)."""
    view = mujoco.MjvScene(model, 100)
    every = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, every, view)
    left, right = view.camera
    near = left.frustum_near if not left.orthographic else 1.0
    sides = np.array(
        [
            left.frustum_center - left.frustum_width,
            left.frustum_center + left.frustum_width,
            left.frustum_top,
            left.frustum_bottom,
        ]
    )
    return (left.pos + right.pos) / 2, left.forward, left.up, sides / near


def model_camera(index):
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
    camera.fixedcamid = index
    return camera


def assert_same_view(model, data, bound, camera):
    pos, forward, up, (left, right, top, bottom) = mujoco_frustum(model, data, camera)
    pose = pose_of(model, data, bound)
    mat = pose.mat.reshape(3, 3)
    np.testing.assert_allclose(pose.pos, pos, atol=1e-5)
    np.testing.assert_allclose(-mat[:, 2], forward, atol=1e-6)
    np.testing.assert_allclose(mat[:, 1], up, atol=1e-6)
    np.testing.assert_allclose(np.cross(mat[:, 0], mat[:, 1]), mat[:, 2], atol=1e-9)
    pixels = bound.model
    assert pixels.cy / pixels.fy == pytest.approx(top, rel=1e-5)
    assert (pixels.height - pixels.cy) / pixels.fy == pytest.approx(-bottom, rel=1e-5)
    if left == right:  # MuJoCo takes the width from the window: square pixels
        assert pixels.fx == pixels.fy
        assert pixels.cx == pixels.width / 2
    else:
        assert pixels.cx / pixels.fx == pytest.approx(-left, rel=1e-5)
        assert (pixels.width - pixels.cx) / pixels.fx == pytest.approx(right, rel=1e-5)


def test_every_camera_of_the_model_sees_what_mujoco_sees(model, data):
    for index in range(model.ncam):
        bound = bind_camera(model, model.camera(index).name or str(index), WIDTH, HEIGHT)
        assert_same_view(model, data, bound, model_camera(index))
    assert bind_camera(model, "flat", WIDTH, HEIGHT).model.orthographic


@pytest.mark.slow
def test_every_camera_of_every_shipped_robot(robot_files):
    for path in robot_files.values():
        model = load_model(path)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for index in range(model.ncam):
            bound = bind_camera(model, str(index), WIDTH, HEIGHT)
            assert_same_view(model, data, bound, model_camera(index))


def test_the_free_camera_is_mujocos(model, data):
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    model_without = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    )
    bound = bind_camera(model_without, "", 640, 480)
    default = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model_without, default)
    assert bound.name == "free"
    assert_same_view(model_without, mujoco.MjData(model_without), bound, default)

    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (1, 0, 2), 3, 35, -70
    config = CameraConfig(lookat=(1, 0, 2), distance=3, azimuth=35, elevation=-70)
    assert_same_view(model, data, bind_camera(model, "", WIDTH, HEIGHT, config), camera)
    camera.elevation = model.vis.global_.elevation
    config = CameraConfig(lookat=(1, 0, 2), distance=3, azimuth=35)
    assert_same_view(model, data, bind_camera(model, "", WIDTH, HEIGHT, config), camera)


def test_no_name_means_the_models_first_camera(model):
    assert bind_camera(model, "", WIDTH, HEIGHT).name == "fixed"


def test_a_mounted_camera_rides_on_its_body(model, data):
    config = CameraConfig(body="arm", pos=(0.5, 0, 0.2), xyaxes=(0, -2, 0, 0, 0.3, 3), fovy=60)
    pose = pose_of(model, data, bind_camera(model, "", WIDTH, HEIGHT, config))
    # the same camera, written into the model
    xml = MODEL.replace(
        '<camera name="follow"',
        '<camera name="own" pos=".5 0 .2" xyaxes="0 -2 0 0 .3 3" fovy="60"/><camera name="follow"',
    )
    other = mujoco.MjModel.from_xml_string(xml)
    bound = bind_camera(other, "own", WIDTH, HEIGHT)
    expected = pose_of(other, data, bound)
    np.testing.assert_allclose(pose.pos, expected.pos, atol=1e-12)
    np.testing.assert_allclose(pose.mat, expected.mat, atol=1e-12)
    assert bind_camera(model, "", WIDTH, HEIGHT, config).model == bound.model
    quat = tuple(other.cam_quat[other.camera("own").id])
    turned = CameraConfig(body="arm", pos=(0.5, 0, 0.2), quat=quat)
    pose = pose_of(model, data, bind_camera(model, "", WIDTH, HEIGHT, turned))
    np.testing.assert_allclose(pose.mat, expected.mat, atol=1e-12)


def test_config_gives_a_models_camera_other_optics(model):
    wide = bind_camera(model, "lens", WIDTH, HEIGHT, CameraConfig(fovy=90)).model
    assert wide.fx == wide.fy == pytest.approx(HEIGHT / 2)
    config = CameraConfig(focal_px=(300, 310), principal_px=(170, 131))
    own = bind_camera(model, "fixed", WIDTH, HEIGHT, config).model
    assert (own.fx, own.fy, own.cx, own.cy) == (300, 310, 170, 131)


def test_orthographic_fovy_is_the_height_in_metres(model):
    flat = bind_camera(model, "flat", WIDTH, HEIGHT).model
    assert flat.fy == flat.fx == HEIGHT / 2.0


@pytest.mark.parametrize(
    ("name", "config", "message"),
    [
        ("fixd", CameraConfig(), "no camera 'fixd'; there is: fixed,"),
        ("77", CameraConfig(), "no camera '77'"),
        ("", CameraConfig(body="amr"), "no body 'amr'; there is: arm"),
        ("fixed", CameraConfig(body="arm"), "more than one camera is described"),
        ("", CameraConfig(body="arm", azimuth=3), "more than one camera is described"),
        ("", CameraConfig(distance=0), "camera.distance is 0"),
        ("", CameraConfig(azimuth=float("nan")), "angles finite"),
        ("", CameraConfig(body="arm", quat=(0, 0, 0, 0)), "camera.quat"),
        ("", CameraConfig(body="arm", xyaxes=(1, 0, 0, 2, 0, 0)), "camera.xyaxes"),
        ("fixed", CameraConfig(fovy=180), "camera.fovy is 180"),
        ("fixed", CameraConfig(fovy=0), "camera.fovy is 0"),
        ("fixed", CameraConfig(focal_px=(0, 3)), "camera.focal_px"),
    ],
)
def test_bad_descriptions_are_one_clear_line(model, name, config, message):
    with pytest.raises(EvsError) as caught:
        bind_camera(model, name, WIDTH, HEIGHT, config)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("width", "height"), [(0, 260), (346, -1), (1 << 20, 1 << 20)])
def test_absurd_resolutions_are_refused(model, width, height):
    with pytest.raises(EvsError, match=f"a sensor of {width} x {height} px has no picture"):
        bind_camera(model, "fixed", width, height)


ON_A_FLOOR = """
<mujoco>
  <worldbody>
    <geom type="plane" size="50 50 .1"/>
    <geom type="box" pos="30 0 1" size="2 2 2"/>
    <body pos="3 0 1">
      {joint}
      <geom type="capsule" fromto="-.2 0 0 .4 .3 .5" size=".05"/>
      <geom type="sphere" size="9" group="3"/>
      <body pos=".4 0 -.5"><joint axis="0 1 0"/><geom type="box" size=".1 .02 .3"/></body>
    </body>
  </worldbody>
  {key}
</mujoco>
"""
FREE = "<freejoint/>"
AWAY = '<keyframe><key name="home" qpos="-7 2 .4 0.6 0.8 0 0 1.2"/></keyframe>'


def filled(model, width, height, config=None):
    """The robot's corners in a free camera's picture: lowest and highest share of each half."""
    bound = bind_camera(model, "", width, height, config)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    corners = []
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] and model.geom_group[geom] < 3:
            center, half = np.split(model.geom_aabb[geom], 2)
            signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1)
            turn = data.geom_xmat[geom].reshape(3, 3)
            corners.append(
                data.geom_xpos[geom] + (turn @ (center[:, None] + half[:, None] * signs)).T
            )
    pose = pose_of(model, data, bound)
    seen = (np.concatenate(corners) - pose.pos) @ pose.mat.reshape(3, 3)
    assert (seen[:, 2] < 0).all()
    x = seen[:, 0] / -seen[:, 2] * bound.model.fx / (width / 2)
    y = seen[:, 1] / -seen[:, 2] * bound.model.fy / (height / 2)
    return np.abs([x, y]).max()


@pytest.mark.parametrize("key", ["", AWAY])
@pytest.mark.parametrize("joint", [FREE, ""])
@pytest.mark.parametrize("size", [(346, 260), (100, 300)])
def test_the_free_camera_shows_the_robot_whole_and_not_the_floor(joint, key, size):
    key = key if joint else key.replace("-7 2 .4 0.6 0.8 0 0 ", "")
    model = mujoco.MjModel.from_xml_string(ON_A_FLOOR.format(joint=joint, key=key))
    whole = filled(model, *size)
    # limbs fill between a third of the picture's shorter half and all but a sixth of it
    assert 0.33 < whole < 0.84
    for config in (
        CameraConfig(azimuth=10.0, elevation=-80.0),
        CameraConfig(fovy=120.0),
        CameraConfig(focal_px=(90.0, 140.0)),
    ):
        assert 0.2 < filled(model, *size, config) < 0.84


def test_a_free_camera_that_is_given_stays_where_it_is():
    model = mujoco.MjModel.from_xml_string(ON_A_FLOOR.format(joint=FREE, key=""))
    config = CameraConfig(lookat=(1.0, 2.0, 3.0), distance=2.0, azimuth=90.0, elevation=0.0)
    pose = bind_camera(model, "", 64, 48, config).mount.fixed
    np.testing.assert_allclose(pose.pos, (1.0, 0.0, 3.0), atol=1e-12)


@pytest.mark.slow
def test_the_free_camera_of_every_shipped_robot_shows_it(robot_files):
    for name, path in robot_files.items():
        model = load_model(path)
        if model.nkey or not (model.geom_bodyid > 0).any():
            continue
        assert filled(model, WIDTH, HEIGHT, CameraConfig(azimuth=60.0)) < 1.0, name
