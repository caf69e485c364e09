"""Glowing geoms as lamps: their light beside an integral over their surface, and as they spin."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import pytest

from evs.emulator.base.scene import SceneSnapshot
from reference.instants import Film
from reference.scenes import SAMPLED_OUTLINES

F64 = npt.NDArray[np.float64]
WIDTH, HEIGHT = 40, 30
ASSETS = """<statistic extent="4"/><visual><headlight active="0"/><map znear="0.001"/></visual>
  <asset><material name="paper" specular="0" rgba="1 1 1 1"/>
    <material name="lamp" rgba="1 1 1 1" emission="10" specular="0"/>
    <material name="dim" rgba="1 1 1 1" emission=".001" specular="0"/></asset>"""
CAMERA = '<camera pos="0 -1.5 1" xyaxes="1 0 0 0 .35 1" fovy="70"/>'
CORNER = """<geom type="plane" size="2 2 1" material="paper"/>
  <geom type="plane" size="2 2 1" pos="0 1.5 1" euler="90 0 0" material="paper"/>
  <geom type="plane" size="2 2 1" pos="-1 0 1" euler="0 90 0" material="paper"/>"""


class Scene(Film):
    def __init__(self, world: str) -> None:
        xml = f"<mujoco>{ASSETS}<worldbody>{world}{CAMERA}</worldbody></mujoco>"
        super().__init__(xml, (WIDTH, HEIGHT))

    def seen(self, tick: int = 0) -> SceneSnapshot:
        mujoco.mj_forward(self.model, self.data)
        return self.taker.snapshot(self.data, 1000 * tick, 1000)

    def renderer(self, threads: int = 1, **how: Any) -> Any:
        return super().renderer(threads, SAMPLED_OUTLINES, **{"renderer": "hybrid", **how})


def surface_of(shape: str, size: F64, n: int = 120) -> tuple[F64, F64, F64]:
    """Points of a shape, their normals and areas: (k, 3), (k, 3), (k,)."""
    at = (np.arange(n) + 0.5) / n * 2 - 1
    if shape == "sphere":
        turn, z = np.meshgrid(np.pi * at, at)
        ring = np.sqrt(1 - z**2)
        normal = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], -1).reshape(-1, 3)
        return size[0] * normal, normal, np.full(n * n, 4 * np.pi * size[0] ** 2 / n**2)
    u, v = (grid.ravel() for grid in np.meshgrid(at, at))
    faces = []
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            if shape == "plane" and (axis, sign) != (2, 1.0):
                continue
            point, normal = np.zeros((n * n, 3)), np.zeros((n * n, 3))
            point[:, axis] = 0 if shape == "plane" else sign * size[axis]
            point[:, b], point[:, c], normal[:, axis] = u * size[b], v * size[c], sign
            faces.append((point, normal, np.full(n * n, 4 * size[b] * size[c] / n**2)))
    points, normals, areas = zip(*faces, strict=True)
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lamp", "lit"),
    [
        # through the wall, and sunk in the floor: a part is below their horizon
        ('type="sphere" size=".35" pos="-.8 .8 .5"', (2,)),
        ('type="box" size=".4 .3 .2" pos=".2 .9 .1" euler="0 0 30"', (0,)),
        ('type="sphere" size=".002" pos=".3 .5 .8"', (0, 1, 2)),
        ('type="box" size=".02 .6 .4" pos="-.97 .6 1"', (0, 1, 2)),  # a panel before a wall
        ('type="box" size=".3 .2 .1" pos=".2 .6 .7" euler="30 40 20"', (0, 1, 2)),
        ('type="box" size=".002 .003 .001" pos=".2 .6 .7" euler="30 40 20"', (0, 1, 2)),
        ('type="plane" size=".4 .3 1" pos=".2 .6 1.2" euler="160 20 0"', (0, 1, 2)),
    ],
)
def test_light_of_a_glowing_geom_is_the_integral_over_its_surface(
    lamp: str, lit: tuple[int, ...]
) -> None:
    scene = Scene(f'{CORNER}<geom {lamp} material="lamp"/>')
    shot = scene.seen()
    pose = shot.cameras[0]
    seen = scene.renderer(bounces=0).render(shot, pose)
    truth = scene.renderer(renderer="direct").ground_truth(shot, pose)
    geom = scene.model.geom(3)
    shape = {0: "plane", 2: "sphere", 6: "box"}[int(geom.type[0])]
    turn, at = scene.data.geom_xmat[3].reshape(3, 3), scene.data.geom_xpos[3]
    points, normals, areas = surface_of(shape, np.asarray(geom.size))
    points, normals = points @ turn.T + at, normals @ turn.T
    errors = []
    for y, x in np.argwhere(np.isin(truth.geom_id, lit))[::7]:
        point, normal = truth.position[y, x], truth.normal[y, x]
        way = points - point
        square = (way**2).sum(1)
        if square.min() < (4 * np.sqrt(areas.max())) ** 2:
            continue  # the integral is not fine enough there
        emitted = np.maximum(-(way * normals).sum(1), 0)
        received = np.maximum(way @ normal, 0)
        expected = 10 * (emitted * received * areas / square**2).sum() / np.pi
        errors.append((seen[y, x] - expected) / max(expected, 1e-4 * seen.max()))
    print(len(errors), np.quantile(np.abs(errors), [0.5, 0.9, 0.99, 1]))
    assert len(errors) > 30
    assert np.abs(errors).max() < 2e-3


SPINNING = {
    "sphere": ('type="sphere" size=".15"', (1, 0.7, 0.2)),
    "capsule": ('type="capsule" size=".1 .15"', (0, 0, 1)),
    "cylinder": ('type="cylinder" size=".15 .1"', (0, 0, 1)),
    "ellipsoid": ('type="ellipsoid" size=".2 .1 .1"', (1, 0, 0)),
}


@pytest.mark.parametrize(("renderer", "most"), [("hybrid", 0.015), ("path", 0.003)])
@pytest.mark.parametrize("shape", SPINNING)
def test_a_lamp_that_spins_in_place_keeps_its_light(shape: str, renderer: str, most: float) -> None:
    """A threshold is 0.1 to 0.3. What is left is light that the lamp reflects, from nodes that
    turn with it."""
    geom, axis = SPINNING[shape]
    world = f"""{CORNER}<geom type="box" size=".2 .2 .2" pos=".4 .6 .2" material="paper"/>
      <body mocap="true" pos="-.1 .5 .8"><geom {geom} material="lamp"/></body>"""
    dim = "".join(
        f'<geom type="box" size=".005 .005 .005" pos="{x} -.9 .01" material="dim"/>'
        for x in (0.1, 0.2, 0.3)
    )
    lights = []
    for more in ("", dim):
        scene = Scene(world + more)
        one = scene.renderer(renderer=renderer, spp=4, bounces=1)
        for tick in range(24 if more else 1):
            half = 0.05 * tick
            turn = np.array(axis) / np.linalg.norm(axis) * np.sin(half)
            scene.data.mocap_quat[0] = [np.cos(half), *turn]
            shot = scene.seen(tick)
            lights.append(np.log(one.render(shot, shot.cameras[0]) + 1e-4))
    swing = np.ptp(lights[1:], axis=0)
    assert np.median(swing) < 0.2 * most
    assert np.quantile(swing, 0.95) < most
    # dim lamps do not take the points of a bright one
    if renderer == "hybrid":
        assert np.quantile(np.abs(lights[1] - lights[0]), 0.99) < 0.01
