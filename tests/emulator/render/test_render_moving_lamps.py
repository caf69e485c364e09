"""A camera that stands while lamps move: only what they reach shines anew, with the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evs.emulator.base.scene import SceneSnapshot
from evs.emulator.config import CameraConfig, FlickerConfig
from evs.emulator.render import NativeRenderer
from reference.instants import Film

WIDTH, HEIGHT = 118, 90  # no multiple of a packet, nor of a block of them
PACKETS = 30 * 23

SCENE = """
<mujoco>
  <visual><headlight active="{head}"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 0" width="32"
            height="192"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .6" width="64"
            height="64"/>
    <material name="floor" texture="tiles" texrepeat="2 2" texuniform="true" reflectance="{mirror}"
            specular=".8"/>
    <material name="glass" rgba=".2 .5 .8 .4"/>
    <mesh name="wedge" vertex="0 0 0  .5 0 0  0 .5 0  0 0 .5"/>
  </asset>
  <worldbody>
    <light type="spot" pos="-1 0 2" dir="0 0 -1" cutoff="25" exponent="4" diffuse="{tint}"
           ambient=".1 .1 .1"/>
    <light type="directional" dir=".3 .2 -1" diffuse=".2 .2 .2"/>
    <light type="spot" pos="1 .3 1.5" dir="0 0 -1" cutoff="40" castshadow="false"/>
    <geom type="plane" size="6 6 .1" material="floor"/>
    <geom type="box" size=".2 .2 .2" pos="-.6 .5 .2"/>
    <geom type="mesh" mesh="wedge" pos=".6 .5 .1"/>
    <geom type="ellipsoid" size=".2 .1 .2" pos="0 .8 .5" material="glass"/>
    <geom type="capsule" size=".1 .25" pos="-.9 0 .6" euler="30 40 0"/>
    <geom type="sphere" size=".12" pos=".6 -.3 .7"/>
  </worldbody>
</mujoco>
"""
VIEW = CameraConfig(lookat=(0, 0, 0.5), distance=3.0, azimuth=70, elevation=-12)
LAMP, OTHER = 1, 3
"""indices of lights: the headlight comes first"""
CAPSULE, SPHERE = 4, 5

MANY: list[dict[str, Any]] = [
    {"spp": 1},
    {"spp": 2, "antialiasing": "fixed"},
    {"spp": 4, "antialiasing": "adaptive"},
]
SAMPLES = pytest.mark.parametrize("render", MANY, ids=["1", "2", "4 adaptive"])


class Set(Film):
    """A scene at one instant, which a script changes as it likes."""

    def __init__(self, tint: str = ".6 .6 .6", mirror: float = 0.3, *, head: bool = True) -> None:
        text = SCENE.format(tint=tint, mirror=mirror, head=int(head))
        super().__init__(text, (WIDTH, HEIGHT), VIEW)
        # the lamps keep their indices without a headlight
        self.first_lamp = 0 if head else -1


Script = Callable[[Set, int], None]


def tick(kept: NativeRenderer, full: NativeRenderer, shot: SceneSnapshot) -> tuple[int, int]:
    """Packets that were traced and lit again; the light has to be that of a full frame."""
    before = kept.work
    light = kept.render(shot, shot.cameras[0]).tobytes()
    assert light == full.render(shot, shot.cameras[0]).tobytes()
    after = kept.work
    traced, relit = (after[key] - before[key] for key in ("packets_traced", "packets_relit"))
    return traced, relit


def play(stage: Set, script: Script, ticks: int, **render: Any) -> Iterator[tuple[int, int]]:
    """The film of a script; yields what `tick` gives of each tick after the first."""
    kept, full = stage.renderer(2, **render), stage.renderer(incremental=False, **render)
    assert tick(kept, full, stage.shot) == (PACKETS, 0)
    for k in range(ticks):
        script(stage, k)
        yield tick(kept, full, stage.shot)


def carried(stage: Set, k: int) -> None:
    stage.lamp(LAMP, 0.02, 0.01, 0.0)


def away_and_back(stage: Set, k: int) -> None:
    """A lamp goes where it lights nothing that is seen and comes back; bodies move all the time."""
    stage.geom(CAPSULE, 0.01, 0.0, 0.004)
    stage.geom(SPHERE, -0.02, 0.01, -0.005)
    if k % 20 == 5:
        stage.lamp(LAMP, 0.0, 40.0, 0.0)
    if k % 20 == 12:
        stage.lamp(LAMP, 0.03, -40.0, 0.0)


def away_and_back_over_a_moved_body(stage: Set, k: int) -> None:
    """While the lamp is away its shadow is nobody's concern; afterwards it is again."""
    if k == 2:
        stage.lamp(LAMP, 0.0, 40.0, 0.0)
    if 2 < k < 10:
        stage.geom(CAPSULE, 0.02, 0.0, 0.0)
    if k == 12:
        stage.lamp(LAMP, 0.3, -40.0, 0.0)
    if k > 14:
        stage.geom(CAPSULE, 0.02, 0.0, 0.0)


def entering(stage: Set, k: int) -> None:
    """A spot that shone up turns down, step by step."""
    stage.turn(LAMP, np.sin(3.0 - 0.15 * k), 0.3, -np.cos(3.0 - 0.15 * k))


def stopping(stage: Set, k: int) -> None:
    """A lamp that casts no shadow and one that does move, stop, and bodies go on."""
    if k < 6:
        stage.lamp(LAMP, 0.03, 0.0, 0.0)
        stage.lamp(OTHER, -0.03, 0.0, 0.0)
    if k > 3:
        stage.geom(CAPSULE, 0.01, 0.01, 0.0)
    if k > 12:
        stage.geom(SPHERE, -0.03, 0.0, 0.0)


def together(stage: Set, k: int) -> None:
    """A lamp that goes with a body."""
    stage.lamp(LAMP, 0.01, 0.0, -0.01)
    stage.geom(CAPSULE, 0.01, 0.0, -0.01)


SCRIPTS = [carried, away_and_back, away_and_back_over_a_moved_body, entering, stopping, together]


@SAMPLES
@pytest.mark.parametrize("script", SCRIPTS)
def test_the_light_is_that_of_full_frames(script: Script, render: dict[str, Any]) -> None:
    for stage in (Set(), Set(".6 .3 .2", mirror=0.0), Set(mirror=0.0, head=False)):
        kept = list(play(stage, script, 24, **render))
        # and something was kept
        assert sum(traced for traced, _ in kept) < 0.9 * PACKETS * len(kept)


@SAMPLES
def test_colour_beside_the_luminance_too(render: dict[str, Any]) -> None:
    stage = Set()
    kept, full = (stage.renderer(rgb=True, incremental=k, **render) for k in (True, False))
    for k in range(12):
        together(stage, k)
        tick(kept, full, stage.shot)
        assert kept.rgb is not None
        assert full.rgb is not None
        assert kept.rgb.tobytes() == full.rgb.tobytes()


def test_in_fog_too() -> None:
    stage = Set()
    for _ in play(stage, together, 12, spp=1, fog=True):
        pass


@SAMPLES
@pytest.mark.parametrize("light", ["headlight", "0", "1", "2"])
def test_lamps_that_pulse(light: str, render: dict[str, Any]) -> None:
    """Each of the four, those before the first that casts a shadow and those after it."""
    stage = Set()
    pulse = FlickerConfig(light=light, waveform="pwm", hz=125.0, depth=1.0, duty=0.5)
    kept, full = (stage.renderer(incremental=k, flicker=(pulse,), **render) for k in (True, False))
    for k in range(20):
        stage.shot = replace(stage.shot, t_us=1000 * (k + 1), exposure_us=1000)
        if k > 8:
            stage.geom(CAPSULE, 0.01, 0.0, 0.0)
        traced, relit = tick(kept, full, stage.shot)
        # four ticks on, four off
        if 0 < k <= 8 and k % 4:
            assert (traced, relit) == (0, 0)


def test_what_a_lamp_does_not_reach_is_left_alone() -> None:
    stage = Set()
    renderer = stage.renderer()
    shot, pose = stage.shot, stage.shot.cameras[0]
    before = renderer.render(shot, pose).copy()
    stage.lamp(LAMP, 0.02, 0.01, 0.0)
    after = renderer.render(stage.shot, pose)
    changed = np.zeros((23 * 4, 30 * 4), np.bool_)
    changed[:HEIGHT, :WIDTH] = before != after
    needed = int(changed.reshape(23, 4, 30, 4).any((1, 3)).sum())
    found = renderer.work["packets_traced"] - PACKETS + renderer.work["packets_relit"]
    assert 0 < needed <= found < 1.3 * needed
    assert found < 0.5 * PACKETS


def test_shapes_alone_are_lit_again_and_not_traced() -> None:
    # without a mirror; the wedge is a mesh, glass shows what is behind it, edges show two geoms
    for traced, relit in play(Set(mirror=0.0), carried, 10, spp=1):
        assert relit > 2 * traced > 0


def test_a_lamp_out_of_sight_costs_nothing() -> None:
    stage = Set()
    stage.lamp(LAMP, 0.0, 40.0, 0.0)
    stage.lamp(OTHER, 0.0, 40.0, 0.0)

    def wander(stage: Set, k: int) -> None:
        stage.lamp(LAMP, 0.1, 0.0, 0.0)
        stage.turn(OTHER, 1.0, 0.1 * k, -1.0)

    assert set(play(stage, wander, 10, spp=1)) == {(0, 0)}


def test_a_shadow_that_moves_is_lit_again_and_not_traced() -> None:
    """A body behind the camera: nothing else of it is seen."""
    stage = Set(mirror=0.0)
    stage.geom(SPHERE, -1.6, 0.3, 1.0)

    def drift(stage: Set, k: int) -> None:
        stage.geom(SPHERE, 0.01, 0.0, 0.0)

    counts = list(play(stage, drift, 10, spp=1))
    assert sum(relit for _, relit in counts) > sum(traced for traced, _ in counts)


@pytest.mark.parametrize("seed", range(4))
def test_lamps_and_bodies_at_random(seed: int) -> None:
    rng = np.random.default_rng(seed)
    jumps = 10.0 ** rng.uniform(-4, 0, 60)

    def script(stage: Set, k: int) -> None:
        move = rng.normal(size=(4, 3)) * jumps[k]
        if rng.random() < 0.5:
            stage.lamp(LAMP, *move[0])
        if rng.random() < 0.2:
            stage.turn(LAMP, *rng.normal(size=3))
        if rng.random() < 0.3:
            stage.lamp(OTHER, *move[1])
        for geom, by in ((CAPSULE, move[2]), (SPHERE, move[3])):
            if rng.random() < 0.5:
                stage.geom(geom, *0.2 * by)

    for _ in play(Set(mirror=0.3 * (seed % 2)), script, 60, **MANY[seed % 3]):
        pass
