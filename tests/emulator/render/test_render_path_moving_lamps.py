"""Paths with a camera that stands while lamps move: what the lamps light again, and from what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import LightKind, SceneModel
from evs.emulator.config import CameraConfig, FlickerConfig
from reference.instants import Film

WIDTH, HEIGHT = 75, 50  # no multiple of a packet
TICKS = 14
SCENE = """
<mujoco>
  <visual>
    <headlight active="1" ambient=".1 .1 .1"/>
    <map fogstart="2" fogend="9" haze=".4"/>
    <rgba fog=".3 .4 .5 1" haze=".8 .7 .6 1"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 0" width="32"
            height="192"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .6" width="64"
            height="64"/>
    <texture name="dice" type="cube" builtin="gradient" rgb1=".9 .2 .1" rgb2=".1 .2 .9" width="16"
            height="96"/>
    <material name="floor" texture="tiles" texrepeat="2 2" texuniform="true" reflectance=".2"/>
    <material name="dice" texture="dice" emission=".1"/>
    <material name="glass" rgba=".2 .5 .8 .4"/>
    <material name="metal" rgba=".8 .6 .2 1" metallic=".9" roughness=".1"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
  </asset>
  <worldbody>
    <light type="spot" pos="-.5 0 3" dir="0 0 -1" cutoff="30" exponent="4" bulbradius=".02"
           diffuse=".6 .5 .4"/>
    <light type="directional" dir=".3 .2 -1" diffuse=".2 .2 .2"/>
    <light type="point" pos="1.5 .5 2" diffuse=".3 .4 .5" bulbradius=".3"/>
    <geom type="plane" size="0 0 .1" material="floor"/>
    {geoms}
    <geom type="capsule" size=".05 .2" pos=".9 -.2 1.2" euler="0 60 0"/>
  </worldbody>
</mujoco>
"""
WALL = '<geom type="{}" size="{}" pos="0 .3 .6" euler="20 10 30" material="{}"/>'
KINDS = {
    "floor alone": "",
    "sphere": WALL.format("sphere", ".6", "dice"),
    "capsule": WALL.format("capsule", ".4 .5", "floor"),
    "ellipsoid": WALL.format("ellipsoid", ".9 .5 .6", "metal"),
    "cylinder": WALL.format("cylinder", ".6 .4", "dice"),
    "box": WALL.format("box", ".7 .4 .5", "floor"),
    "mesh": '<geom type="mesh" mesh="wedge" pos="-.5 .2 .1" material="metal"/>',
    "glass": WALL.format("box", ".7 .4 .5", "glass"),
    "metal": WALL.format("box", ".7 .4 .5", "metal"),
}
VIEW = CameraConfig(lookat=(0, 0, 0.5), distance=3.0, azimuth=70, elevation=-12)
SPOT, SUN, BULB = 1, 2, 3
"""indices of lights: the headlight comes first"""


class Scene(Film):
    """A scene whose capsule moves, and its lamps as `script` has it."""

    def __init__(
        self, geoms: str, change: Callable[[SceneModel], SceneModel] | None = None
    ) -> None:
        super().__init__(SCENE.format(geoms=geoms), (WIDTH, HEIGHT), VIEW)
        if change:
            self.scene = change(self.scene)

    def check(self, script: Callable[[Film, int], None], **render: Any) -> float:
        """The light is that of full frames, tick after tick. Out: the share that was traced."""
        render = {"renderer": "path", "spp": 2, **render}
        full = self.renderer(incremental=False, **render)
        kept = [self.renderer(threads=2, **render)]
        kept += [self.renderer(isa=isa, **render) for isa in _core.isa_available()]
        traced = 0.0
        for tick in range(TICKS):
            script(self, tick)
            self.shot = replace(self.shot, t_us=1000 * tick, exposure_us=1000)
            light = full.render(self.shot, self.shot.cameras[0]).tobytes()
            for other in kept:
                assert other.render(self.shot, self.shot.cameras[0]).tobytes() == light, tick
            traced += kept[0].traced_fraction if tick else 0.0
        return traced / (TICKS - 1)


CAPSULE = -1
"""index of the geom that moves"""


def carried(film: Film, tick: int) -> None:
    """The spot goes with the capsule, which goes through the picture."""
    film.lamp(SPOT, 0.02, 0.01, 0.0)
    film.geom(CAPSULE, -0.1, 0.01, -0.02)


def several(film: Film, tick: int) -> None:
    """Each in its turn, two at once, none: the geom goes on."""
    if tick % 4 < 2:
        film.lamp(BULB, -0.05, 0.02, 0.0)
    if tick % 3 == 0:
        film.turn(SUN, 0.1 * tick, 0.2, -1.0)
    if tick > 8:
        film.turn(SPOT, 0.05 * tick, 0.1, -1.0)
    film.geom(CAPSULE, -0.08, 0.0, -0.01)


def stops_and_starts(film: Film, tick: int) -> None:
    """Long enough for the lamps to count as still, and for the capsule to come and to go."""
    if tick in (1, 2, 12, 13):
        film.lamp(SPOT, 0.04, 0.0, 0.0)
    film.geom(CAPSULE, -0.2 if tick < 8 else 0.25, 0.0, -0.02)


def away_and_back(film: Film, tick: int) -> None:
    """The spot turns away from all that is seen, and back."""
    film.turn(SPOT, 0.0, 0.3 * max(0, 4 - abs(tick - 7)), -1.0 if abs(tick - 7) > 2 else 1.0)


def in_turns(film: Film, tick: int) -> None:
    """Where the capsule was in front it is gone, and the other way round, while it stands."""
    film.lamp(SPOT, 0.0, 0.02, 0.0)
    if tick % 3 == 0:
        film.geom(CAPSULE, -0.9 if tick % 2 else 0.9, 0.0, 0.0)


def roll(film: Film, tick: int) -> None:
    """What is seen first stays where it is, but turns: another part of its texture."""
    film.lamp(SPOT, 0.0, 0.02, 0.0)
    if tick % 4 == 1:
        angle = 0.4 * tick
        turn = [np.cos(angle), -np.sin(angle), 0, np.sin(angle), np.cos(angle), 0, 0, 0, 1]
        mats = film.shot.geom_mat.copy()
        mats[1] = np.array(turn).reshape(mats[1].shape)
        film.shot = replace(film.shot, geom_mat=mats)


Script = Callable[[Film, int], None]
SCRIPTS: list[Script] = [carried, several, stops_and_starts, away_and_back, in_turns]
MANY: list[dict[str, Any]] = [
    {"spp": 1, "bounces": 0},
    {"spp": 4, "sampler": "anchored", "bounces": 1},
    {"spp": 3, "sampler": "random", "fog": True},
    {"spp": 2, "sampler": "sobol", "bounces": 3},
]


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_light_is_that_of_full_frames(kind: str, script: Script) -> None:
    number = list(KINDS).index(kind) + SCRIPTS.index(script)
    traced = Scene(KINDS[kind]).check(script, **MANY[number % len(MANY)])
    assert traced < 0.9


def test_a_shape_that_turns_in_its_place_shows_another_colour() -> None:
    Scene(KINDS["sphere"]).check(roll)


def test_lamps_that_pulse() -> None:
    for light in ("headlight", "0", "1", "2"):
        pulse = FlickerConfig(light=light, waveform="pwm", hz=125.0, depth=1.0, duty=0.5)
        Scene(KINDS["box"]).check(lambda film, tick: None, flicker=(pulse,))


def two_spots(scene: SceneModel) -> SceneModel:
    """Of the lamps only the spot casts a shadow, and the bulb is a spot, too."""
    lights = [replace(light, castshadow=k == SPOT) for k, light in enumerate(scene.lights)]
    lights[BULB] = replace(lights[BULB], kind=LightKind.SPOT, cutoff_deg=35.0)
    return replace(scene, lights=tuple(lights))


def leaving(film: Film, tick: int) -> None:
    """The spot leaves; then the other does, which had stood so far; both come back."""
    film.geom(CAPSULE, -0.05, 0.0, 0.0)
    if tick in (2, 9):
        film.lamp(SPOT, 40.0 if tick == 2 else -40.0, 0.0, 0.0)
    if tick in (5, 12):
        film.lamp(BULB, 40.0 if tick == 5 else -40.0, 0.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_where_no_lamp_shines_that_moves_the_light_is_that_of_full_frames(kind: str) -> None:
    Scene(KINDS[kind], two_spots).check(leaving)
    Scene(KINDS[kind], two_spots).check(away_and_back, bounces=1)
