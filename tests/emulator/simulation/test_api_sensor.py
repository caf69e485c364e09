"""Sensor: events inside a loop that the user owns, and nothing of the user's is touched."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator import EventCamera, World
from evs.emulator.config import CameraConfig, SensorConfig
from evs.emulator.world import load_model
from evs.msgs import EVENT_DTYPE, EvsError

SMALL = SensorConfig(preset="davis346", width=64, height=48)


@pytest.fixture
def humanoid(robot_files):
    return load_model(robot_files["gymnasium/humanoid"])


def wave(t_s, nu):
    return 0.3 * np.sin(30 * t_s + np.arange(nu))


def test_a_users_loop_gives_the_events_of_our_world(robot_files):
    path = robot_files["gymnasium/humanoid"]
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    sensor = EventCamera(model, "track", sensor=SMALL, seed=11, threads=1)
    assert len(sensor.observe(data)) == 0
    mine = []
    for tick in range(40):
        data.ctrl[:] = wave(tick * 1e-3, model.nu)
        mujoco.mj_step(model, data)
        mine.append(sensor.observe(data))

    world = World(path, control=lambda t_s, _d: wave(t_s, model.nu), seed=11, threads=1)
    world.add_camera("track", sensor=SMALL)
    theirs = [packet.events for (packet,) in world.run(0.04)]
    assert [events.tobytes() for events in mine] == [events.tobytes() for events in theirs]
    assert sum(map(len, mine)) > 100
    assert mine[0].dtype == EVENT_DTYPE


def everything(data):
    """All that a user could look at, as bytes."""
    size = mujoco.mj_stateSize(data.model, mujoco.mjtState.mjSTATE_INTEGRATION)
    state = np.zeros(size)
    mujoco.mj_getState(data.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    names = (
        "geom_xpos",
        "geom_xmat",
        "cam_xpos",
        "xpos",
        "subtree_com",
        "qacc",
        "qM",
        "light_xpos",
    )
    fields = [getattr(data, name) for name in names if hasattr(data, name)]
    assert len(fields) > 5
    return [array.tobytes() for array in (state, data.warning.number, *fields)]


def image(model):
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def test_neither_model_nor_data_is_touched(humanoid):
    data = mujoco.MjData(humanoid)
    for _ in range(5):
        mujoco.mj_step(humanoid, data)
    before, model_before = everything(data), image(humanoid)
    sensor = EventCamera(humanoid, sensor=SMALL)
    sensor.observe(data)
    assert everything(data) == before
    assert image(humanoid) == model_before
    mujoco.mj_step(humanoid, data)
    before = everything(data)
    sensor.observe(data)
    assert everything(data) == before
    assert image(humanoid) == model_before


def test_any_step_length_will_do(humanoid):
    data = mujoco.MjData(humanoid)
    sensor = EventCamera(humanoid, sensor=SMALL)
    sensor.observe(data)
    assert sensor.packet is None
    bases = []
    for steps in (1, 3, 2):
        for _ in range(steps):
            mujoco.mj_step(humanoid, data)
        events = sensor.observe(data)
        assert sensor.packet.events is events
        bases.append((sensor.packet.seq, sensor.packet.time_base_us, sensor.packet.time_end_us))
    assert bases == [(0, 0, 3000), (1, 3000, 12_000), (2, 12_000, 18_000)]


def test_time_that_stands_or_goes_back_asks_for_a_reset(humanoid):
    data = mujoco.MjData(humanoid)
    sensor = EventCamera(humanoid, sensor=SMALL)
    mujoco.mj_step(humanoid, data)
    sensor.observe(data)
    with pytest.raises(EvsError, match=r"time went from 3000 us to 3000 us.*reset\(\)"):
        sensor.observe(data)
    mujoco.mj_resetData(humanoid, data)
    with pytest.raises(EvsError, match=r"time went from 3000 us to 0 us.*reset\(\)"):
        sensor.observe(data)
    sensor.reset()
    assert len(sensor.observe(data)) == 0


def test_a_reset_sensor_is_as_new(humanoid):
    sensor = EventCamera(humanoid, sensor=SMALL, seed=1)

    def episode():
        data = mujoco.MjData(humanoid)
        data.qvel[:] = 1.0
        sensor.observe(data)
        seen = []
        for _ in range(5):
            mujoco.mj_step(humanoid, data)
            seen.append(sensor.observe(data).tobytes())
        assert sensor.packet.seq == 4
        return seen

    first = episode()
    sensor.reset()
    assert sensor.packet is None
    assert episode() == first
    assert len(b"".join(first)) > 0


def test_an_edited_model_is_seen_as_any_other_change_of_light(humanoid):
    humanoid.opt.gravity[:] = 0
    data = mujoco.MjData(humanoid)
    sensor = EventCamera(humanoid, "track", sensor=SMALL)
    sensor.observe(data)
    mujoco.mj_step(humanoid, data)
    calm = len(sensor.observe(data))
    before = sensor.luminance
    for geom in range(humanoid.ngeom):
        humanoid.geom_rgba[geom, :3] = (0.9, 0.1, 0.1)
    humanoid.vis.headlight.ambient[:] = 0.9
    mujoco.mj_step(humanoid, data)
    events = sensor.observe(data)
    assert np.abs(sensor.luminance - before).max() > 0.05
    # the pixels kept their state, so the new colours are a change that they report
    assert len(events) > calm + 1000
    assert sensor.packet.seq == 1


def test_cameras_by_description_and_what_is_known_of_the_stream(humanoid):
    config = CameraConfig(body="torso", pos=(-3, 0, 0), xyaxes=(0, -1, 0, 0, 0, 1), fovy=60)
    sensor = EventCamera(humanoid, config, sensor=SMALL, name="eye")
    data = mujoco.MjData(humanoid)
    sensor.observe(data)
    assert sensor.luminance.any()
    assert sensor.info.camera == "eye"
    assert sensor.info.tick_us == 3000


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda m: EventCamera("humanoid.xml"), "takes a mujoco.MjModel, not str; gymnasium: env."),
        (lambda m: EventCamera(m, "trakc"), "no camera 'trakc'; there is: track"),
        (lambda m: EventCamera(m, sensor="davis"), "no sensor"),
        (
            lambda m: EventCamera(m, sensor=SMALL).observe(None),
            "takes a mujoco.MjData, not NoneType",
        ),
    ],
)
def test_bad_input_is_one_clear_line(humanoid, act, says):
    with pytest.raises(EvsError) as caught:
        act(humanoid)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_data_of_another_model_or_of_no_time(humanoid, robot_files):
    sensor = EventCamera(humanoid, sensor=SMALL)
    other = mujoco.MjData(load_model(robot_files["gymnasium/ant"]))
    with pytest.raises(EvsError, match="the data belongs to another model"):
        sensor.observe(other)
    data = mujoco.MjData(humanoid)
    data.time = float("nan")
    with pytest.raises(EvsError, match=r"data\.time is nan"):
        sensor.observe(data)
