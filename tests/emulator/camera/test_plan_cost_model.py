"""The plan's cost model against what was measured once, and what it says of itself."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from evs.emulator.camera.scene_plan import Cost
from evs.emulator.config import CameraConfig, RenderConfig, RunConfig, SceneConfig, SensorConfig
from evs.emulator.simulation.world import World
from speed.many import many_geoms

# CPU ms of world, render and sensor in a tick, one thread; the core that the model was fitted on
RESTS = {
    ("dm_control/cartpole", "direct", (346, 260)): (0.038, 0.039, 0.072),
    ("dm_control/cartpole", "path", (346, 260)): (0.050, 0.022, 0.100),
    ("dm_control/cartpole", "direct", (1280, 720)): (0.036, 0.401, 0.853),
    ("gymnasium/walker2d", "direct", (346, 260)): (0.042, 0.044, 0.070),
}
MOVES = {
    ("dm_control/humanoid", "direct", (346, 260)): (0.200, 6.18, 0.393),
    ("dm_control/quadruped", "direct", (346, 260)): (0.335, 7.62, 0.216),
    ("gymnasium/ant", "direct", (346, 260)): (0.151, 6.37, 0.480),
}


def cost(file: Path, renderer: str, size: tuple[int, int]) -> Cost:
    world = World.from_config(
        RunConfig(
            scene=SceneConfig(file=str(file)),
            camera=CameraConfig(azimuth=70, elevation=-20),
            sensor=SensorConfig(width=size[0], height=size[1]),
            render=RenderConfig(renderer=renderer, spp=4),
            threads=1,
        )
    )
    world.step()
    return world.cameras[0].plan.cost


@pytest.mark.parametrize(("case", "took"), RESTS.items())
def test_a_scene_at_rest(
    robot_files: dict[str, Path],
    case: tuple[str, str, tuple[int, int]],
    took: tuple[float, ...],
) -> None:
    robot, renderer, size = case
    told = cost(robot_files[robot], renderer, size)
    for model, ms in zip(
        (told.world_ms, told.render_still_ms, told.sensor_still_ms), took, strict=True
    ):
        assert ms / told.within < model < ms * told.within


@pytest.mark.parametrize(("case", "took"), MOVES.items())
def test_a_scene_in_motion(
    robot_files: dict[str, Path],
    case: tuple[str, str, tuple[int, int]],
    took: tuple[float, ...],
) -> None:
    robot, renderer, size = case
    told = cost(robot_files[robot], renderer, size)
    for model, ms in zip((told.world_ms, told.render_ms, told.sensor_ms), took, strict=True):
        assert ms / told.within < model < ms * told.within


@pytest.mark.parametrize(
    ("count", "renderer", "ms"),
    [(1000, "direct", 12.9), (4000, "direct", 31.6), (1000, "path", 64.0), (4000, "path", 120.0)],
)
def test_a_scene_of_many_geoms(tmp_path: Path, count: int, renderer: str, ms: float) -> None:
    """What tests/bench/test_light_many_speed.py measures, times 4 samples."""
    mujoco.mj_saveLastXML(str(tmp_path / "many.xml"), many_geoms(count).model)
    told = cost(tmp_path / "many.xml", renderer, (346, 260))
    assert ms / told.within < told.render_ms < ms * told.within
