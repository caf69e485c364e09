"""Reasons fit decisions: what the code runs by, and what the scene is said to contain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from evs.emulator.base.features import FEATURES, NATIVE
from evs.emulator.camera.scene_plan import ScenePlan
from evs.emulator.config import RenderConfig, RunConfig, SceneConfig, SensorConfig
from evs.emulator.simulation.world import World
from evs.emulator.world import load_model
from evs.msgs import EvsError
from reference.planned import IDEAL, NEEDS, Film, told

ROBOTS = ["gymnasium/humanoid", "gymnasium/ant", "dm_control/dog", "dm_control/fish"]


def check(plan: ScenePlan, features: dict[str, bool], renderer: str) -> None:
    """The counts of the contents say the same as the flags that the tracer runs by."""
    has = plan.contents
    path = renderer in ("hybrid", "path")
    on = {decision.feature.name: decision.on for decision in plan.decisions}
    assert on == {name: features[name] for name in on}
    assert on["colour"] == (renderer == "path" or bool(has.coloured))
    assert on["physical_gloss"] == (path or has.physical > 0)
    assert on["normal_maps"] == (has.bumpy > 0)
    assert on["texture_filter"] == (has.textured > 0)
    assert on["sky"] == has.sky
    assert on["fog"] == has.fog
    # and the camera above that plane
    assert on["haze"] <= has.haze
    assert on["shadows"] == (has.casting > 0)
    assert on["plane_shadows"] <= (has.casting > 0 and has.planes > 0)
    assert on["glowing"] == (path and has.glowing > 0)
    assert on["transparent"] == (path and has.transparent > 0)
    assert on["refits"] <= (has.deforming > 0)
    assert on["hierarchy"] == (sum(has.geoms.values()) - has.planes > 128)
    assert on["light_reach"] == (has.bounded > 4)
    assert on["cached_light"] == (renderer == "hybrid")
    assert all(decision.why for decision in plan.decisions)
    assert plan.mobility.bodies_moving + plan.mobility.bodies_still > 0


@pytest.mark.parametrize("name", NEEDS)
def test_films(name: str, tmp_path: Path) -> None:
    world = NEEDS[name].world(tmp_path)
    told(world, 2)
    camera = world.cameras[0]
    check(camera.plan, camera.features, NEEDS[name].render.get("renderer", "direct"))


@pytest.mark.slow
@pytest.mark.parametrize("renderer", ["direct", "hybrid", "path"])
@pytest.mark.parametrize("name", ROBOTS)
def test_robots(name: str, renderer: str, robot_files: dict[str, Path]) -> None:
    check_robot(robot_files[name], renderer)


@pytest.mark.slow
def test_every_robot(robot_files: dict[str, Path]) -> None:
    checked = 0
    for file in robot_files.values():
        try:
            load_model(str(file))
        except EvsError:  # a piece of a model, or one whose files lie elsewhere
            continue
        check_robot(file, "direct")
        checked += 1
    assert checked > 30


def check_robot(file: Path, renderer: str) -> None:
    world = World.from_config(
        RunConfig(
            scene=SceneConfig(file=str(file)),
            sensor=SensorConfig(**{**IDEAL, "width": 16, "height": 12}),
            render=RenderConfig(renderer=renderer, spp=1),
            threads=1,
        )
    )
    world.step()
    camera = world.cameras[0]
    check(camera.plan, camera.features, renderer)


def test_the_tracers_names_are_the_tables(tmp_path: Path) -> None:
    renderer: Any = Film().world(tmp_path).cameras[0]._renderer
    assert {*renderer._caster.features} == {*NATIVE}
    assert {*NATIVE} <= {feature.name for feature in FEATURES}


def test_a_moving_camera_and_a_tracking_one_are_told(robot_files: dict[str, Path]) -> None:
    says = {}
    for camera in ("track", ""):
        world = World.from_config(
            RunConfig(
                scene=SceneConfig(file=str(robot_files["gymnasium/humanoid"]), camera=camera),
                sensor=SensorConfig(**IDEAL),
            )
        )
        world.step()
        says[camera] = world.cameras[0].plan.mobility.camera_moves
    assert says["track"] == says[""] == "body 'torso' carries it"
