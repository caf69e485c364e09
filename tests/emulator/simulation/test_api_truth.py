"""Ground truth through the Python face: cameras, sensors, views."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator.base.scene import F32

SCENE = """
<mujoco>
  <option gravity="0 0 0" timestep=".001"/>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <camera name="above" pos="0 0 3" fovy="40"/>
    <geom type="plane" size="2 2 .1"/>
    <body name="ball" pos="0 0 1"><freejoint/><geom type="sphere" size=".3"/></body>
  </worldbody>
  <keyframe><key name="fly" qpos="0 0 1 1 0 0 0" qvel="2 0 0 0 0 0"/></keyframe>
</mujoco>"""
SIZE = evs.SensorConfig("ideal", width=32, height=24)
FOCAL = 12 / np.tan(np.radians(20))


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


def expect_flight(depth: F32, flow: F32, body: np.ndarray) -> None:
    ball = body == 1
    assert ball.sum() > 10
    expected = np.stack([FOCAL * 2 / depth[ball], 0 * depth[ball]], 1)
    np.testing.assert_allclose(flow[ball], expected, rtol=1e-3, atol=0.05)
    assert (flow[body == 0] == 0).all()


def test_a_camera_of_a_world_tells_the_truth_of_each_tick(model: mujoco.MjModel) -> None:
    world = evs.World(model)
    camera = world.add_camera("above", sensor=SIZE)
    with pytest.raises(evs.EvsError, match="has seen nothing yet"):
        camera.ground_truth()
    world.data.qvel[0] = 2.0
    for tick in range(1, 4):
        world.step()
        truth = camera.ground_truth()
        assert truth.t_us == 1000 * tick
        expect_flight(truth.depth, truth.flow, truth.body_id)


def test_a_sensor_in_ones_own_loop_does_too(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    sensor = evs.EventCamera(model, "above", sensor=SIZE)
    sensor.observe(data)
    assert np.isnan(sensor.ground_truth().flow).all()
    for _ in range(5):
        mujoco.mj_step(model, data)
    sensor.observe(data)
    truth = sensor.ground_truth()
    assert truth.t_us == 5000
    expect_flight(truth.depth, truth.flow, truth.body_id)
    sensor.refresh()
    with pytest.raises(evs.EvsError, match="has seen nothing yet"):
        sensor.ground_truth()


def test_events_are_the_same_with_and_without_it(model: mujoco.MjModel) -> None:
    asked, plain = (evs.World(model, seed=3) for _ in range(2))
    camera, _ = (one.add_camera("above", sensor=SIZE) for one in (asked, plain))
    for one in (asked, plain):
        one.data.qvel[0] = 2.0
    total = 0
    for _ in range(10):
        (packet,), (other,) = asked.step(), plain.step()
        camera.ground_truth()
        assert packet.events.tobytes() == other.events.tobytes()
        total += len(packet)
    assert total > 0


def test_a_view_sees_light_colour_and_truth_beside_a_camera(model: mujoco.MjModel) -> None:
    world = evs.World(model)
    world.data.qvel[0] = 2.0
    camera = world.add_camera("above", sensor=SIZE)
    view = world.add_view("above", sensor=SIZE, rgb=True)
    other = world.add_camera("above", sensor=SIZE)
    assert (view.t_us, view.name, view.width, view.height) == (0, "above", 32, 24)
    assert view.camera_info == camera.info.camera_info
    before = view.ground_truth()
    assert np.isnan(before.flow).all()
    for _ in range(3):
        world.step()
    luminance, rgb = view.render()
    np.testing.assert_array_equal(luminance, camera.luminance)
    np.testing.assert_array_equal(luminance, other.luminance)
    assert rgb is not None
    np.testing.assert_allclose(rgb @ [0.2126, 0.7152, 0.0722], luminance, rtol=1e-5)
    truth = view.ground_truth()
    assert truth.t_us == view.t_us == 3000
    expect_flight(truth.depth, truth.flow, truth.body_id)
    colourless = world.add_view("above", sensor=SIZE)
    assert colourless.render()[1] is None


def test_a_view_that_was_added_late_knows_the_tick_before(model: mujoco.MjModel) -> None:
    world = evs.World(model)
    world.data.qvel[0] = 2.0
    world.step()
    view = world.add_view("above", sensor=SIZE)
    world.step()
    truth = view.ground_truth()
    expect_flight(truth.depth, truth.flow, truth.body_id)
