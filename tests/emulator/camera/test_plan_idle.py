"""A code path that nothing needs changes no byte when it runs all the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.base.features import FEATURES, Switches
from evs.emulator.config import ModelConfig, PlanConfig, RenderConfig, RunConfig, SceneConfig
from evs.emulator.config import SensorConfig as Sensor
from evs.emulator.simulation.world import World
from reference.planned import IDEAL, NEEDS, PATH, PLAIN, SKY, Film, told

TICKS = 10
IDLE = [feature.name for feature in FEATURES if not feature.idle]

# what has no place in the plain film: paths alone have this, its floor an image, the network tiles
OWN = {"glowing": replace(PLAIN, render=PATH), "texture_filter": Film({"image": ""})}
NETWORK = {"name": "evsnet", "network": "evsnet_c8"}
OWN["outlines"] = replace(PLAIN, render=PATH)
OWN["cold_tiles"] = replace(PLAIN, model=NETWORK)


@pytest.mark.parametrize("name", IDLE)
def test_on_is_off_byte_for_byte(name: str, tmp_path: Path) -> None:
    film = OWN.get(name, PLAIN)
    bare, idle = film.world(tmp_path), film.world(tmp_path, on=[name])
    given = told(bare, TICKS)
    assert told(idle, TICKS) == given
    assert any(events for events, *_ in given)
    assert bare.cameras[0].luminance.tobytes() == idle.cameras[0].luminance.tobytes()
    assert [world.cameras[0].features[name] for world in (bare, idle)] == [False, True]


@pytest.mark.parametrize("integrator", ["direct", pytest.param("path", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["plain", *NEEDS])
def test_everything_is_as_the_scene_alone(name: str, integrator: str, tmp_path: Path) -> None:
    """Films that need one thing, with all the others on as well."""
    film = NEEDS.get(name, PLAIN)
    if integrator == "path":
        film = replace(film, render={**film.render, **PATH})
    alone, all_on = film.world(tmp_path), film.world(tmp_path, all_on=True)
    assert told(alone, 6) == told(all_on, 6)
    assert alone.cameras[0].luminance.tobytes() == all_on.cameras[0].luminance.tobytes()
    on = {x for x, runs in all_on.cameras[0].features.items() if runs}
    left = {*IDLE} - on - {"cold_tiles"}
    if integrator == "direct" and "renderer" not in film.render:
        left -= {"glowing"}
    if film.xml.get("asset") == SKY:
        left -= {"fog"}  # it would hide the sky
    if "shadows" not in on:
        left -= {"plane_shadows"}  # no light asks
    if name == "lens":
        left -= {"outlines"}
    assert left == set()


def test_fog_that_is_asked_for_idly_never_hides_a_sky(tmp_path: Path) -> None:
    film = Film({"asset": SKY})
    bare, idle = film.world(tmp_path), film.world(tmp_path, on=["fog"])
    assert told(bare, 4) == told(idle, 4)
    (decision,) = [x for x in idle.cameras[0].plan.decisions if x.feature.name == "fog"]
    assert (decision.on, decision.forced) == (False, False)
    assert "no place here" in decision.why


def test_networks_see_the_same_with_cold_tiles_and_chunks(tmp_path: Path) -> None:
    chunked = replace(PLAIN, model={**NETWORK, "chunk": 8})
    streams = []
    for options in ({}, {"on": ["cold_tiles"]}, {"all_on": True}):
        world = chunked.world(tmp_path, **options)  # type: ignore[arg-type]
        packets = [packet for step in world.run(0.03) for packet in step]
        streams.append(b"".join(packet.events.tobytes() for packet in packets))
    assert streams[0]
    assert streams[0] == streams[1] == streams[2]


def test_a_saved_state_says_that_other_code_paths_ran(tmp_path: Path) -> None:
    bare, idle = PLAIN.world(tmp_path), PLAIN.world(tmp_path, all_on=True)
    for world in (bare, idle):
        told(world, 2)
    blob = idle.save()
    again = PLAIN.world(tmp_path, all_on=True)
    again.restore(blob)
    assert told(again, 4) == told(idle, 4)
    with pytest.raises(Exception, match="plan"):
        bare.restore(blob)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["gymnasium/humanoid", "gymnasium/ant", "gymnasium/reacher", "dm_control/dog",
     "dm_control/quadruped", "dm_control/manipulator"],
)  # fmt: skip
@pytest.mark.parametrize("how", ["direct", "path", "evsnet"])
def test_everything_on_robots(name: str, how: str, robot_files: dict[str, Path]) -> None:
    """A DAVIS346's pixel with all its terms, smaller."""
    renderer = "path" if how == "path" else "direct"
    runs = []
    for everything in (False, True):
        world = World.from_config(
            RunConfig(
                scene=SceneConfig(file=str(robot_files[name]), control="random"),
                sensor=Sensor(width=64, height=48),
                render=RenderConfig(renderer=renderer, spp=2),
                model=ModelConfig(name="evsnet" if how == "evsnet" else "plain"),
                plan=PlanConfig(everything=everything),
                seed=1,
            )
        )
        runs.append(told(world, 40))
    assert runs[0] == runs[1]
    assert sum(len(events) for events, *_ in runs[0]) > 0


def test_the_ideal_pixel_is_ideal() -> None:
    """The films' sensor has none of the terms that these tests switch on."""
    assert IDEAL["preset"] == "ideal"
    assert Switches() == Switches.of(PlanConfig())
    assert np.isfinite(IDEAL["pos_thres"])
