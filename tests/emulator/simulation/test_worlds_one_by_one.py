"""Worlds that cannot be stepped together are stepped one by one, with the same bytes."""

from __future__ import annotations

import importlib.util
import threading
import time
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator import Worlds
from evs.emulator.config import FlickerConfig, ModelConfig, RenderConfig, SensorConfig
from evs.emulator.config.sensor import ApsConfig, ImuConfig
from reference.worlds_alone import SWING, assert_same_states, both, change_both, step_both

SMALL = SensorConfig("dvs128", width=32, height=24)

CLOTH = """<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".2 .2 .2" radius=".02" dim="2"
  pos="-.3 .5 1" mass="1"><edge equality="true"/></flexcomp></worldbody>"""
ROPE = """<tendon><spatial name="string" width=".02" rgba=".9 .9 .2 1"><site site="tip"/>
  <site site="hook"/></spatial></tendon><sensor>"""

SCENES = {
    "swing": SWING,
    "cloth": SWING.replace("</worldbody>", CLOTH).replace('qpos="-1"', ""),
    "rope": SWING.replace("</worldbody>", '<site name="hook" pos="0 0 1.5"/></worldbody>').replace(
        "<sensor>", ROPE, 1
    ),
    "sleep": SWING.replace(
        '<option timestep=".001"/>',
        '<option timestep=".001" sleep_tolerance=".1"><flag sleep="enable"/></option>',
    ),
}


def turn(t_s: float, _: Any) -> list[float]:
    """A control that follows from the time."""
    return [float(np.sin(300 * t_s))]


def look(_: float, data: Any) -> list[float]:
    """One that follows from the world."""
    return [float(-data.qvel[0])]


FRAMES = SensorConfig("davis346", width=32, height=24, aps=ApsConfig(enabled=True))
IMU = SensorConfig("davis346", width=32, height=24, imu=ImuConfig(enabled=True))
FRESH = RenderConfig(renderer="path", spp=1, seeds="fresh")
CYCLE = RenderConfig(renderer="path", spp=1, seeds="cycle")
FLICKER = RenderConfig(flicker=(FlickerConfig(light="lamp", hz=200.0),))
Case = tuple[str, dict[str, Any], dict[str, Any], str]

# name -> scene, options of the worlds, options of the camera, the reason
CASES: dict[str, Case] = {
    "a flex": ("cloth", {}, {}, "the model has skins or flexes"),
    "a tendon": ("rope", {}, {}, "the model shows tendons, ropes or slider-cranks"),
    "sleep": ("sleep", {}, {}, "the model puts bodies to sleep"),
    "a control function": (
        *("swing", {"control": look}, {}),
        "the control is a function of the data",
    ),
    "fresh seeds": ("swing", {}, {"render": FRESH}, "camera 'left': render.seeds is fresh"),
    "a cycle": ("swing", {}, {"render": CYCLE}, "camera 'left': the renderer is not native"),
    "flicker": ("swing", {}, {"render": FLICKER}, "camera 'left': render.flicker is in use"),
    "evsnet": (
        *("swing", {}, {"model": ModelConfig(name="evsnet")}),
        "camera 'left': the event model is EvsNetModel",
    ),
    "labels": (
        *("swing", {}, {"model": ModelConfig(labels=True)}),
        "camera 'left': frames, IMU, labels or ground truth are made in every tick",
    ),
    "frames": (
        *("swing", {}, {"sensor": FRAMES}),
        "camera 'left': frames, IMU, labels or ground truth are made in every tick",
    ),
    "an IMU": (
        *("swing", {}, {"sensor": IMU}),
        "camera 'left': frames, IMU, labels or ground truth are made in every tick",
    ),
}


def scene_of(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENES[name])


def spin(number: int, world: Any) -> None:
    world.data.qvel[0] = 5.0 + number


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("threads", [2, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 5))])
def test_one_by_one_gives_the_same_bytes_and_the_reason(name: str, threads: int) -> None:
    scene, options, camera, reason = CASES[name]
    cameras = [{"camera": "left", "sensor": SMALL, **camera}]
    worlds, alone = both(scene_of(scene), 3, cameras, threads=threads, **options)
    assert worlds.one_by_one == reason
    change_both(worlds, alone, spin)
    assert step_both(worlds, alone, ticks=3) > 0
    step_both(worlds, alone, ticks=[2, 0, 1])
    assert_same_states(worlds, alone)
    blobs = worlds.save([2, 0])
    worlds.reset(4, [1])
    alone.each[1].reset(4 + 65536)
    worlds.restore(blobs, [0, 2])
    for number, blob in zip((0, 2), blobs, strict=True):
        alone.each[number].restore(blob)
    step_both(worlds, alone, ticks=3)
    assert_same_states(worlds, alone)


def test_the_reasons_that_are_not_of_the_model_or_a_camera() -> None:
    worlds = Worlds(scene_of("swing"), 2)
    assert worlds.one_by_one == "there is no camera yet"
    worlds.step(ticks=2)
    assert worlds.t_us.tolist() == [2000, 2000]
    worlds.add_camera("left", sensor=SMALL)
    assert worlds.one_by_one == ""
    worlds.add_camera("right", sensor=SMALL, render=RenderConfig(headlight="off"))
    assert worlds.one_by_one == "cameras differ in render.headlight"
    assert Worlds(scene_of("swing"), 1).one_by_one == "there is one world"


def test_an_older_mujoco_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *more: None if name == "mujoco.batch" else find(name, *more),
    )
    worlds, alone = both(scene_of("swing"), 2, [{"camera": "left", "sensor": SMALL}])
    change_both(worlds, alone, spin)
    assert worlds.one_by_one.startswith(f"MuJoCo {mujoco.__version__} has no mujoco.batch")
    assert step_both(worlds, alone, [[0.5], [-0.5]], ticks=5) > 0
    assert_same_states(worlds, alone)


def test_what_is_measured_and_what_ends_does_so_one_by_one() -> None:
    worlds, alone = both(
        scene_of("swing"),
        3,
        [{"camera": "left", "sensor": SMALL}],
        control=turn,
        limits={"angle": (-2.0, 0.02)},
        sensors=("rate",),
    )
    together, _ = both(
        scene_of("swing"),
        3,
        [{"camera": "left", "sensor": SMALL}],
        limits={"angle": (-2.0, 0.02)},
        sensors=("rate",),
    )
    change_both(worlds, alone, lambda number, world: world.data.qvel.fill(3.0 * number))
    for number in range(3):
        together.world(number).data.qvel[0] = 3.0 * number
    controls = [[0.25]] * 3
    seen, expected = worlds.step(controls, ticks=9), together.step(controls, ticks=9)
    assert worlds.one_by_one
    assert not together.one_by_one
    assert (
        worlds.ended
        == together.ended
        == {
            1: "angle left -2 ... 0.02",
            2: "angle left -2 ... 0.02",
        }
    )
    assert seen[0].offsets.tolist() == expected[0].offsets.tolist()
    assert seen[0].events.view(np.uint8).tobytes() == expected[0].events.view(np.uint8).tobytes()
    assert worlds.readings["rate"].tobytes() == together.readings["rate"].tobytes()
    assert worlds.t_us.tolist() == together.t_us.tolist() == [9000, 7000, 4000]


def test_an_unstable_world_ends_one_by_one_too() -> None:
    worlds, alone = both(
        scene_of("swing"), 3, [{"camera": "left", "sensor": SMALL}], control=look, threads=2
    )
    change_both(worlds, alone, lambda number, world: world.data.qvel.fill(1e13 if number else 4.0))
    assert step_both(worlds, alone, ticks=3) > 0
    assert [*worlds.ended] == [1, 2]
    assert_same_states(worlds, alone)


def test_a_control_function_is_called_for_one_world_after_the_other() -> None:
    busy, clashes = threading.Lock(), []

    def control(t_s: float, data: Any) -> list[float]:
        if not busy.acquire(blocking=False):
            clashes.append(t_s)
            return [0.0]
        time.sleep(0.003)
        busy.release()
        return [0.0]

    worlds = Worlds(scene_of("swing"), 4, control=control, threads=2)
    worlds.add_camera("left", sensor=SMALL)
    worlds.step(ticks=5)
    assert clashes == []


def test_a_python_function_of_mujoco_is_a_reason_or_acts() -> None:
    worlds, alone = both(scene_of("swing"), 2, [{"camera": "left", "sensor": SMALL}])
    change_both(worlds, alone, spin)
    mujoco.set_mjcb_control(lambda model, data: data.qfrc_applied.fill(1.0))
    try:
        step_both(worlds, alone, ticks=3)
    finally:
        mujoco.set_mjcb_control(None)
    assert_same_states(worlds, alone)
