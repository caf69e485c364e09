"""The first run of a robot that nobody here has seen: it starts as its author means it to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evs.emulator import ClosedLoop, World
from evs.emulator.config import SceneConfig
from evs.launch.main import main
from evs.msgs import EvsError

ROBOT = """
<mujoco model="arm">
  <option timestep="0.002"/>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <geom type="plane" size="50 50 .1"/>
    <body pos="0 0 1">
      <joint name="lift" type="slide" axis="0 0 1" damping="50"/>
      <geom type="box" size=".1 .1 .1" mass="1"/>
    </body>
  </worldbody>
  <actuator><position name="hold" joint="lift" kp="500" ctrlrange="-1 1"/></actuator>
  <keyframe>
    <key name="low" qpos="-0.2" ctrl="-0.2"/>
    <key name="home" qpos="0.4" ctrl="0.4"/>
  </keyframe>
</mujoco>
"""
SMALL = ["sensor.width=16", "sensor.height=12", "--duration", "0.01", "render.spp=1"]


@pytest.fixture
def robot(tmp_path: Path) -> str:
    file = tmp_path / "arm.xml"
    file.write_text(ROBOT)
    return str(file)


def test_a_scene_is_a_word_of_emulate_and_render(
    robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["emulate", robot, *SMALL]) == 0
    assert f" emulate {robot} sensor.width=16" in capsys.readouterr().out
    assert main(["emulate", "fast", robot, *SMALL]) == 0
    out = tmp_path / "arm.npz"
    assert main(["render", robot, *SMALL, "--fps", "100", "-o", str(out)]) == 0
    assert out.is_file()


def test_a_run_says_first_where_it_starts_and_what_became_of_the_physics_step(
    robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["emulate", robot, *SMALL]) == 0
    said = capsys.readouterr().err.splitlines()
    assert said == [
        "evs: starts from keyframe 'home' and holds its control; scene.keyframe=none: from the "
        "model's qpos0",
        "evs: 1 physics step of 1 ms in each tick of 1 ms (the model asks for 2 ms; "
        "scene.tick_us=2000 keeps it)",
    ]
    assert main(["emulate", robot, *SMALL, "scene.tick_us=2000", "scene.keyframe=none"]) == 0
    assert capsys.readouterr().err == ""
    assert main(["emulate", robot, *SMALL, "--quiet"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("keys", "begins", "ctrl"),
    [
        ({}, 0.4, 0.4),
        ({"control": "zero"}, 0.4, 0.0),
        ({"keyframe": "none"}, 0.0, 0.0),
        ({"keyframe": "low"}, -0.2, 0.0),
        ({"keyframe": "home"}, 0.4, 0.4),
        ({"keyframe": "low", "control": "zero"}, -0.2, 0.0),
        ({"control": "keyframe"}, 0.4, 0.4),
    ],
)
def test_home_is_where_it_starts_and_what_it_holds(
    robot: str, keys: dict[str, str], begins: float, ctrl: float
) -> None:
    world = World(SceneConfig(file=robot, **keys))
    for _ in range(2):
        assert world.data.qpos[0] == begins
        for _ in range(20):
            world.step()
        assert world.data.ctrl[0] == ctrl
        world.reset()
    world.reset(keyframe="none")
    assert world.data.qpos[0] == 0.0
    world.reset(keyframe=0)  # type: ignore[arg-type]
    assert world.data.qpos[0] == -0.2
    with pytest.raises(EvsError, match="no keyframe '7'; there is: "):
        world.reset(keyframe=7)  # type: ignore[arg-type]


def test_a_loop_starts_at_home_and_holds_it_until_a_decision(robot: str) -> None:
    loop = ClosedLoop(robot)
    loop.reset()
    assert loop.world.data.qpos[0] == 0.4
    loop.step(ticks=5)
    assert loop.ctrl.tolist() == [0.4]
    loop.step([0.1])
    assert loop.world.data.ctrl.tolist() == [0.1]
    blob = loop.save()
    loop.reset(keyframe="low")
    assert (loop.world.data.qpos[0], loop.world.data.ctrl[0]) == (-0.2, -0.2)
    loop.restore(blob)
    assert loop.world.data.ctrl.tolist() == [0.1]


def test_no_keyframe_and_the_control_of_one_contradict_each_other(robot: str) -> None:
    with pytest.raises(EvsError, match=r"name it in scene\.keyframe, not none"):
        World(SceneConfig(file=robot, keyframe="none", control="keyframe"))


def test_a_model_without_home_starts_as_ever(tmp_path: Path) -> None:
    file = tmp_path / "plain.xml"
    file.write_text(ROBOT.replace('name="home"', 'name="rest"'))
    world = World(file)
    world.step()
    assert (world.keyframe, world.data.ctrl.tolist()) == ("", [0.0])
    assert np.abs(world.data.qpos).max() < 1e-3
