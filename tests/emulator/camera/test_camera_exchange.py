"""Another sensor in a reset: the same bytes as a camera that was made with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import pytest

import evs
from evs.emulator.config import ApsConfig, ImuConfig, SensorConfig
from evs.msgs import EvsError

CART = "config/scenes/cartpole.xml"
FIRST = SensorConfig("davis346", width=32, height=24)
SECOND = replace(
    FIRST, pos_thres=0.2, neg_thres=0.15, cutoff_hz=80.0, shot_noise_rate_hz=20.0, white_lux=30.0
)


def scene() -> str:
    import evs.emulator

    return str(evs.emulator.__path__[0]) + "/../" + CART


def episode(loop: evs.ClosedLoop) -> list[bytes]:
    return [packet.events.tobytes() for _ in range(40) for packet in loop.step([0.5]).packets]


def test_a_loop_with_another_sensor_is_a_new_loop_with_that_sensor() -> None:
    cameras = ("onboard", "watch")
    loop = evs.ClosedLoop(scene(), cameras, sensor=FIRST, threads=1)
    loop.reset(seed=3)
    first = episode(loop)
    loop.reset(seed=5, sensor=SECOND)
    found = episode(loop)
    fresh = evs.ClosedLoop(scene(), cameras, sensor=SECOND, threads=1)
    fresh.reset(seed=5)
    assert found == episode(fresh)
    assert sum(map(len, found)) > 16 * 100
    # header and saved state are those of the new sensor
    assert loop.streams == fresh.streams
    assert loop.streams[0].config["sensor"]["white_lux"] == 30.0
    blob = loop.save()
    fresh.restore(blob)
    assert episode(fresh) == episode(loop)
    # and back again
    loop.reset(seed=3, sensor=FIRST)
    assert episode(loop) == first
    with pytest.raises(EvsError, match="sensor"):
        loop.restore(blob)


def test_without_a_sensor_a_reset_keeps_the_last() -> None:
    world = evs.World(scene(), threads=1)
    camera = world.add_camera("onboard", sensor=FIRST)
    world.reset(2, sensor=SECOND)
    one = [packet.events.tobytes() for _ in range(30) for packet in world.step([0.5])]
    world.reset(2)
    assert camera.sensor.white_lux == 30.0
    assert one == [packet.events.tobytes() for _ in range(30) for packet in world.step([0.5])]


def test_a_preset_by_its_name_is_one_of_its_own_size() -> None:
    world = evs.World(scene(), threads=1)
    camera = world.add_camera("onboard", sensor="davis346")
    world.reset(sensor="ideal")
    assert camera.info.sensor == "ideal"
    with pytest.raises(EvsError, match="a sensor of 128 x 128 px for a camera of 346 x 260"):
        world.reset(sensor="dvs128")
    with pytest.raises(EvsError, match="takes a name or a SensorConfig, not 3"):
        world.reset(sensor=3)  # type: ignore[arg-type]
    assert camera.info.sensor == "ideal"


def test_an_event_camera_takes_another_sensor_too() -> None:
    model = mujoco.MjModel.from_xml_path(scene())

    def events(camera: evs.EventCamera) -> bytes:
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.5
        found = b""
        for _ in range(40):
            mujoco.mj_step(model, data)
            found += camera.observe(data).tobytes()
        return found

    camera = evs.EventCamera(model, "onboard", sensor=FIRST, threads=1)
    first = events(camera)
    camera.reset(seed=9, sensor=SECOND)
    fresh = evs.EventCamera(model, "onboard", sensor=SECOND, seed=9, threads=1)
    assert events(camera) == events(fresh) != first
    camera.reset(seed=0, sensor=FIRST)
    assert events(camera) == first


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"width": 40}, "a sensor of 40 x 24 px for a camera of 32 x 24: make another camera"),
        ({"aps": ApsConfig(enabled=True)}, "sensor.aps.enabled would change in a reset"),
        ({"imu": ImuConfig(enabled=True)}, "sensor.imu.enabled would change in a reset"),
        ({"pos_thres": 0.0}, "sensor.pos_thres is 0; give 0.001 ... 20"),
        ({"pos_thres": "a"}, "sensor.pos_thres is 'a'; give a finite number"),
    ],
)
def test_what_cannot_be_exchanged_changes_nothing(change: dict[str, Any], says: str) -> None:
    loop = evs.ClosedLoop(scene(), "onboard", sensor=FIRST, threads=1)
    loop.reset(seed=3)
    first = episode(loop)
    state = loop.save()
    with pytest.raises(EvsError, match=says):
        loop.reset(seed=4, sensor=replace(FIRST, **change))
    assert loop.save() == state
    assert loop.world.seed == 3
    loop.reset()
    assert episode(loop) == first
