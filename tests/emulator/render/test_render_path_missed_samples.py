"""Paths with a camera that stands: samples that something comes near keep their light if no ray of
theirs is met."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import F32, F64
from evs.emulator.config import CameraConfig
from reference.instants import Film

WIDTH, HEIGHT, TICKS = 75, 50, 40  # no multiple of a packet
SCENE = """
<mujoco>
  <visual><headlight active="1" ambient=".1 .1 .1"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 0" width="32"
            height="192"/>
    <material name="glass" rgba=".2 .5 .8 .4"/>
  </asset>
  <worldbody>
    <light type="spot" pos="-.5 0 3" dir="0 0 -1" cutoff="60" diffuse=".6 .5 .4"/>
    {more}
    <geom type="plane" size="0 0 .1"/>
    {geoms}
  </worldbody>
</mujoco>
"""
LAMPS = """
    <light type="point" pos="1.5 .5 2" diffuse=".3 .4 .5" bulbradius=".2"/>
    <light type="directional" dir=".3 .2 -1" diffuse=".2 .2 .2"/>
"""
WALL = '<geom type="box" size=".5 .05 .4" pos="0 .8 .4"/>'
GLASS = '<geom type="box" size=".3 .05 .3" pos="-.5 .3 .4" material="glass"/>'
CAPSULES = (
    '<geom type="capsule" size=".08 .3" pos="0 0 .5" euler="0 70 0"/>'
    '<geom type="capsule" size=".3 .2" pos=".2 .2 .9"/>'
)
CROWD = "".join(
    f'<geom type="sphere" size=".05" pos="{0.16 * (k % 9) - 0.7} {0.2 * (k // 9) - 0.4} .12"/>'
    for k in range(40)  # more than a word has bits
)
VIEW = CameraConfig(lookat=(0, 0, 0.4), distance=3.0, azimuth=70, elevation=-25)
Step = Callable[[int, int, np.random.Generator], F64]
"""(movers, tick) -> (movers, 3) m"""


def slowly(count: int, tick: int, rng: np.random.Generator) -> F64:
    """One of them quick, to and fro; the others a tenth of that."""
    move = np.tile([1e-3, 3e-4, 1e-4], (count, 1))
    move[0] *= 10
    return move if tick // 10 % 2 else -move


def stop_and_go(count: int, tick: int, rng: np.random.Generator) -> F64:
    """Each stands most of the time, and now and then jumps."""
    go = np.where(rng.random((count, 1)) < 0.2, rng.normal(size=(count, 3)) * 5e-3, 0.0)
    return go + np.where(rng.random((count, 1)) < 0.01, [[0.1, 0.0, 0.05]], 0.0)


def drift(count: int, tick: int, rng: np.random.Generator) -> F64:
    """All one way: shadows leave some points, and fall on others."""
    return np.tile([6e-3, 4e-3, 0.0], (count, 1))


class Scene(Film):
    """A scene whose last geoms move."""

    def __init__(self, movers: str, still: str = "", lamps: str = "") -> None:
        super().__init__(SCENE.format(more=lamps, geoms=still + movers), (WIDTH, HEIGHT), VIEW)
        self.count = movers.count("<geom")

    def move(self, step: Step, tick: int, rng: np.random.Generator) -> None:
        pos = self.shot.geom_pos.copy()
        pos[-self.count :] += step(self.count, tick, rng)
        self.shot = replace(self.shot, geom_pos=pos, t_us=1000 * tick, exposure_us=1000)

    def seen_by(self, renderer: Renderer) -> F32:
        return renderer.render(self.shot, self.shot.cameras[0]).copy()


FILMS = {
    "capsules": (CAPSULES, WALL, ""),
    "crowd": (CROWD, "", ""),
    "more lamps than rays are kept": (CAPSULES, "", LAMPS),
    "glass": (CAPSULES, GLASS, ""),
}


@pytest.mark.parametrize("step", [slowly, stop_and_go, drift])
@pytest.mark.parametrize("film", FILMS)
def test_the_light_is_that_of_full_frames(film: str, step: Step) -> None:
    scene, rng = Scene(*FILMS[film]), np.random.default_rng(list(FILMS).index(film))
    spp = 1 + list(FILMS).index(film)
    path = {"renderer": "path", "spp": spp}
    full = scene.renderer(2, incremental=False, **path)
    kept = [scene.renderer(isa=isa, **path) for isa in _core.isa_available()]
    kept.append(scene.renderer(3, **path))
    for tick in range(TICKS):
        light = scene.seen_by(full)
        for other in kept:
            np.testing.assert_array_equal(scene.seen_by(other), light, str(tick))
        assert len({other.traced_fraction for other in kept}) == 1
        scene.move(step, tick, rng)


def test_lamps_begin_to_move_after_a_while() -> None:
    scene, rng = Scene(CAPSULES, WALL), np.random.default_rng(0)
    full, kept = (
        scene.renderer(renderer="path", spp=2, incremental=kept) for kept in (False, True)
    )
    for tick in range(TICKS):
        np.testing.assert_array_equal(scene.seen_by(kept), scene.seen_by(full), str(tick))
        scene.move(slowly, tick, rng)
        if 5 <= tick < 10 or 25 <= tick < 28:
            lamps = scene.shot.light_pos + [0.01, 0.0, 0.0]
            scene.shot = replace(scene.shot, light_pos=lamps)


@pytest.mark.parametrize("step", [slowly, drift])
def test_little_more_is_traced_than_changes(step: Step) -> None:
    scene, rng = Scene(CAPSULES, WALL), np.random.default_rng(0)
    renderer = scene.renderer(renderer="path")
    before, traced, changed = scene.seen_by(renderer), 0.0, 0.0
    for tick in range(TICKS):
        scene.move(step, tick, rng)
        after = scene.seen_by(renderer)
        # the first time that something moves everything is traced
        if tick:
            traced += renderer.traced_fraction
            changed += float(np.mean(after != before))
        before = after
    # what moves but changes nothing: shadows that stay, and rays past what touches them barely
    assert changed < traced < 1.5 * changed, (traced, changed)
