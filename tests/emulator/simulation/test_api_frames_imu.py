"""Frames and IMU through World and EventCamera: a model's own sensors, sync with events, cost."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator import Camera, EventCamera, World
from evs.emulator.config import ApsConfig, CameraConfig, ImuConfig, SensorConfig
from evs.msgs import EvsError, Frame, ImuSamples, empty_imu

SMALL = SensorConfig(preset="ideal", width=48, height=36)
FRAMES = ApsConfig(enabled=True, rate_hz=50.0, exposure_us=5000)
IMU = ImuConfig(enabled=True)

ARM = """
<mujoco>
  <option timestep=".001" integrator="{integrator}"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="9 9 .1" rgba=".4 .5 .3 1"/>
    <body pos="0 0 2">
      <joint name="swing" axis="0 1 0" damping=".01"/>
      <geom type="capsule" fromto="0 0 0 .1 .05 -.5" size=".02" density="1000"/>
      <body pos=".1 .05 -.5">
        <joint name="wrist" axis="1 .3 .2" damping=".001"/>
        <geom type="box" size=".05 .04 .03" density="1000"/>
        <site name="imu" pos=".02 .01 .03"/>
        <camera name="eye" pos=".02 .01 .03" xyaxes="0 -1 0 .2 0 1"/>
        <site name="optical" pos=".02 .01 .03" xyaxes="0 -1 0 -.2 0 -1"/>
      </body>
    </body>
  </worldbody>
  <sensor>
    <accelerometer name="acc" site="optical"/>
    <gyro name="gyro" site="optical"/>
  </sensor>
</mujoco>
"""

EDGE = """
<mujoco>
  <option timestep=".001" gravity="0 0 0"/>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="eye" pos="0 0 2" fovy="45"/>
    <geom type="plane" size="9 9 .1" pos="0 0 -.5" rgba=".3 .3 .3 1"/>
    <body pos="-1.5 0 0">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom type="box" size="1 2 .001" rgba="1 1 1 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def model_of(xml: str, **words: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(xml.format(**words) if words else xml)


def watched(world: World, camera: Camera, ticks: int) -> tuple[list[Frame], ImuSamples, bytes]:
    frames: list[Frame] = []
    samples, events = [empty_imu()], b""
    for _ in range(ticks):
        (packet,) = world.step()
        frames += camera.frames
        samples.append(camera.imu.copy())
        events += packet.events.tobytes()
    return frames, np.concatenate(samples), events


def armed(integrator: str = "Euler") -> World:
    world = World(model_of(ARM, integrator=integrator))
    world.data.qpos[:] = 0.8, 0.4
    world.data.qvel[:] = -1.0, 6.0
    return world


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_the_imu_feels_what_mujocos_own_sensors_feel(integrator: str) -> None:
    world = armed(integrator)
    camera = world.add_camera("eye", sensor=replace(SMALL, imu=IMU))
    found, truth, moving = [], {}, []
    for tick in range(1, 601):
        world.step()
        # mj_step leaves the sensors of its beginning; forward gives those of its end, on a copy
        data = mujoco.MjData(world.model)
        mujoco.mj_copyData(data, world.model, world.data)
        mujoco.mj_forward(world.model, data)
        truth[1000 * tick] = np.concatenate(
            [data.sensor("acc").data.copy(), data.sensor("gyro").data.copy()]
        )
        moving.append(np.abs(world.data.qvel).max())
        found.append(camera.imu.copy())
    samples = np.concatenate(found)
    assert samples["t"].tolist() == list(range(1000, 600_000, 1000))
    exact = np.array([truth[int(t_us)] for t_us in samples["t"]])
    assert np.abs(exact[:, :3]).max() > 13
    assert max(moving) > 5.9
    change = np.abs(np.diff(exact, axis=0)).max(axis=0)
    # an integrator of first order is itself off by a tick's change, at most; RK4 leaves only our
    # differences: a share (w T)^2 / 6 of what is felt, w the fastest turn of the arm
    share = (max(moving) * 1e-3) ** 2 / 6 * np.abs(exact).max() if integrator == "RK4" else change
    both = np.hstack([samples["acceleration"], samples["angular_velocity"]])
    assert (np.abs(both - exact).max(axis=0) < share + 1e-5).all()


def test_at_rest_and_in_free_fall_in_a_world() -> None:
    xml = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="9 9 .1"/>
      <body pos="0 0 5"><freejoint/><geom size=".1"/><camera name="fall" euler="40 30 20"/></body>
      <camera name="rest" pos="0 -3 1" xyaxes="1 0 0 0 0 1"/></worldbody></mujoco>"""
    world = World(model_of(xml))
    falling = world.add_camera("fall", sensor=replace(SMALL, imu=IMU))
    resting = world.add_camera("rest", sensor=replace(SMALL, imu=IMU))
    for tick in range(300):
        world.step()
        if tick > 0:
            (sample,) = falling.imu
            assert np.abs(sample["acceleration"]).max() < 1e-8
            (sample,) = resting.imu
            assert sample["acceleration"] == pytest.approx([0, -9.81, 0], rel=1e-7)
            assert sample["t"] == 1000 * tick
    world.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    world.step()
    assert not resting.imu["acceleration"].any()


def test_a_camera_that_a_mocap_body_carries_feels_its_way() -> None:
    xml = """<mujoco><option timestep=".001"/><worldbody><light pos="0 0 3"/>
      <geom type="plane" size="9 9 .1"/><body name="hand" mocap="true" pos="0 0 1"><geom size=".1"/>
      <camera name="eye" xyaxes="1 0 0 0 0 1"/></body></worldbody></mujoco>"""
    model = model_of(xml)
    data, sensor = mujoco.MjData(model), EventCamera(model, "eye", sensor=replace(SMALL, imu=IMU))
    found = []
    for tick in range(200):
        data.mocap_pos[0] = 0.1 * np.sin(20e-3 * tick), 0.0, 1.0
        mujoco.mj_step(model, data)
        sensor.observe(data)
        found.append(sensor.imu.copy())
    samples = np.concatenate(found)
    # the pose of tick k is seen at (k + 1) ms
    t_s = samples["t"] * 1e-6 - 1e-3
    exact = -0.1 * 20.0**2 * np.sin(20.0 * t_s)
    assert samples["acceleration"][:, 0] == pytest.approx(exact, abs=40 * 0.02**2 / 12 + 1e-5)
    assert samples["acceleration"][:, 1] == pytest.approx(-9.81)


def test_inside_the_users_loop_the_data_is_not_touched_and_the_same_comes_out() -> None:
    both = replace(SMALL, imu=replace(IMU, rate_hz=2000.0), aps=FRAMES)
    world = armed()
    camera = world.add_camera("eye", sensor=both, name="eye")
    ours = watched(world, camera, 120)

    model = model_of(ARM, integrator="Euler")
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (0.8, 0.4), (-1.0, 6.0)
    sensor = EventCamera(model, "eye", sensor=both, name="eye")
    untouched = mujoco.MjData(model)
    mujoco.mj_copyData(untouched, model, data)
    frames, samples, events = [], [], b""
    sensor.observe(data)
    for _ in range(120):
        mujoco.mj_step(model, data)
        mujoco.mj_step(model, untouched)
        events += sensor.observe(data).tobytes()
        frames += sensor.frames
        samples.append(sensor.imu.copy())
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
        states = np.zeros((2, size))
        for row, one in zip(states, (data, untouched), strict=True):
            mujoco.mj_getState(model, one, row, mujoco.mjtState.mjSTATE_INTEGRATION)
        assert (states[0] == states[1]).all()
        for name in ("qacc", "cvel", "cacc", "sensordata", "xpos", "cam_xpos"):
            assert (getattr(data, name) == getattr(untouched, name)).all(), name
    assert events == ours[2]
    assert frames == ours[0]
    assert np.concatenate(samples).tobytes() == ours[1].tobytes()
    assert len(frames) == 6


def test_what_is_off_gives_nothing_and_changes_nothing() -> None:
    seen = {}
    for name, sensor in {
        "off": SMALL,
        "on": replace(SMALL, aps=replace(FRAMES, read_noise_dn=3.0), imu=IMU),
    }.items():
        world = armed()
        camera = world.add_camera("eye", sensor=sensor)
        assert (camera.info.frames, camera.info.imu) == (name == "on", name == "on")
        seen[name] = watched(world, camera, 60)
    assert len(seen["off"][2]) > 16 * 100
    assert seen["off"][2] == seen["on"][2]
    assert (len(seen["off"][0]), len(seen["off"][1])) == (0, 0)
    assert (len(seen["on"][0]), len(seen["on"][1])) == (3, 59)


def test_threads_give_the_same_bytes_and_reset_begins_anew() -> None:
    both = SensorConfig(
        preset="davis346", width=48, height=36, aps=FRAMES, imu=ImuConfig(enabled=True)
    )
    seen = []
    for threads in (1, 2, 3):
        world = World(model_of(ARM, integrator="Euler"), threads=threads, seed=5)
        camera = world.add_camera("eye", sensor=both)
        seen.append(watched(world, camera, 60))
    for other in seen[1:]:
        assert other[0] == seen[0][0]
        assert other[1].tobytes() == seen[0][1].tobytes()
    assert len(np.unique(seen[0][1]["acceleration"])) > 100
    camera.reset()
    assert (camera.frames, len(camera.imu)) == ((), 0)
    again = watched(world, camera, 60)
    assert [(frame.seq, frame.begin_us) for frame in again[0]] == [
        (0, 60_000),
        (1, 80_000),
        (2, 100_000),
    ]
    assert again[1]["t"][0] == 61_000


def test_two_cameras_have_noise_of_their_own() -> None:
    noisy = SensorConfig(preset="davis346", width=48, height=36, aps=FRAMES, imu=IMU)
    world = World(model_of(ARM, integrator="Euler"))
    cameras = [world.add_camera("eye", sensor=noisy) for _ in range(2)]
    # a frame is read out after 5 ms of exposure and 36 rows of 50 us
    for _ in range(7):
        world.step()
    frames = [camera.frames[0] for camera in cameras]
    assert (frames[0].pixels != frames[1].pixels).any()
    assert [frame.camera for frame in frames] == ["eye", "eye_2"]
    assert (cameras[0].imu["acceleration"] != cameras[1].imu["acceleration"]).any()


def test_events_and_frames_of_one_edge_agree_in_time() -> None:
    # an edge of a white sheet slides to the right at 1 m/s, fronto-parallel
    frames_config = ApsConfig(enabled=True, rate_hz=100.0, exposure_us=4000, bits=16, adc_bits=16)
    world = World(model_of(EDGE))
    world.data.qvel[0] = 1.0
    camera = world.add_camera(
        "eye", sensor=SensorConfig(preset="ideal", width=64, height=48, aps=frames_config)
    )
    frames, events = [], []
    for _ in range(400):
        (packet,) = world.step()
        frames += camera.frames
        events.append(packet.events.copy())
    said = np.concatenate(events)
    focal = 24 / np.tan(np.radians(22.5))
    assert len(frames) == 40

    def edge_px(t_s: float) -> float:
        return float(32 + focal * (-0.5 + t_s) / 2.0)

    row = 24
    columns = list(range(18, 28))
    # events: a column's ON events lie where the edge crosses it
    for x in columns:
        stamps = said["t"][(said["x"] == x) & (said["y"] == row) & (said["p"] == 1)]
        places = [edge_px(t_us * 1e-6) for t_us in stamps]
        assert len(places) > 3
        # four samples in a pixel: light steps at quarters of it, spread over a tick's 0.03 px
        assert min(places) > x - 0.05
        assert max(places) < x + 1.05
    # frames: how many columns are covered, on average over the exposure
    dark, white = (float(frames[0].pixels[row, x]) for x in (-1, 0))
    for frame in frames[5:]:
        covered = ((frame.pixels[row].astype(float) - dark) / (white - dark)).sum()
        middle_s = (frame.exposure_begin_us + frame.exposure_end_us) / 2e6
        assert covered == pytest.approx(edge_px(middle_s), abs=0.13)


def test_a_free_camera_stands_still_and_a_mounted_one_moves() -> None:
    world = armed()
    free = world.add_camera(
        CameraConfig(lookat=(0.0, 0.0, 1.0), distance=2.0), sensor=replace(SMALL, imu=IMU)
    )
    for _ in range(3):
        world.step()
    assert np.linalg.norm(free.imu["acceleration"]) == pytest.approx(9.81)


def test_bad_keys_are_told() -> None:
    world = armed()
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"rate_hz": 500.0, "exposure_us": 5000}, "sensor.aps.rate_hz is 500, but a frame takes"),
        ({"shutter": "half"}, "shutter"),
        ({"bits": 9}, "sensor.aps.bits is 9"),
    ]
    for keys, said in wrong:
        with pytest.raises(EvsError) as error:
            world.add_camera("eye", sensor=replace(SMALL, aps=ApsConfig(enabled=True, **keys)))
        assert said in str(error.value)
