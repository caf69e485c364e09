"""The kinds of scene: room, tabletop, floor, clutter, closeup. Each returns its camera."""

from __future__ import annotations

import math

import numpy as np

from evs.emulator.base.scene import F64
from evs_lab.training.scenes.draft import FASTEST, SLOWEST, Draft, num
from evs_lab.training.scenes.materials import glowing, material, sky
from evs_lab.training.scenes.motion import Eye, camera, moving, still
from evs_lab.training.scenes.shapes import mesh, thing

STANDING = 0.25
"""share of the things that do not move"""


def _put(draft: Draft, eye: Eye, place: F64, radius: float, pace: float) -> None:
    """Add one thing: it stands, or moves at some share of the scene's pace."""
    material_name = material(draft, 2 * radius, eye.px_per_m(place), fine=0.3)
    content = thing(draft, radius, material_name)
    if draft.chance(STANDING):
        draft.bodies.append(still(place, content))
        return
    speed = min(FASTEST, max(SLOWEST, pace * draft.log_uniform(0.1, 3.0)))
    draft.bodies.append(moving(draft, eye, place, content, radius, speed))


def _ahead(draft: Draft, eye: Eye, near: float, far: float, spread: float = 0.8) -> F64:
    """Draw a place in the picture, between two distances (m)."""
    right, up, forward = eye.axes()
    away = draft.uniform(near, far)
    half = away * math.tan(math.radians(eye.fovy_deg) / 2) * spread
    across = draft.uniform(-1.3, 1.3) * half * right + draft.uniform(-1.0, 1.0) * half * up
    return np.asarray(eye.place + forward * away + across)


def room(draft: Draft, level: float) -> tuple[Eye, F64, float]:
    """Four walls, floor and ceiling; furniture of any shape; panels that glow."""
    x, y, z = draft.uniform(1.5, 4.0), draft.uniform(1.5, 4.0), draft.uniform(2.2, 3.5)
    place = np.array([draft.uniform(-0.8, -0.3) * x, draft.uniform(-0.6, 0.6) * y, 0.5 * z])
    target = np.array([draft.uniform(0.3, 1.0) * x, draft.uniform(-0.6, 0.6) * y, 0.45 * z])
    eye = Eye(place, target, draft.uniform(35.0, 80.0))
    scale = eye.focal_px / eye.distance
    walls: tuple[tuple[tuple[float, ...], tuple[float, float], tuple[int, int, int]], ...] = (
        ((0, 0, 0), (x, y), (0, 0, 1)),
        ((0, 0, z), (x, y), (0, 0, -1)),
        ((x, 0, z / 2), (z / 2, y), (-1, 0, 0)),
        ((-x, 0, z / 2), (z / 2, y), (1, 0, 0)),
        ((0, y, z / 2), (x, z / 2), (0, -1, 0)),
        ((0, -y, z / 2), (x, z / 2), (0, 1, 0)),
    )
    for at, half, normal in walls:
        material_name = material(draft, 2 * max(half), scale, fine=0.2, reflects=0.05)
        axes = _plane_axes(normal)
        draft.bodies.append(
            f'<geom type="plane" pos="{num(*at)}" size="{num(*half, 0.1)}" '
            f'xyaxes="{num(*axes)}" material="{material_name}"/>'
        )
    pace = draft.speed()
    for _ in range(draft.integer(3, 10)):
        radius = draft.log_uniform(0.06, 0.6)
        spot = _ahead(draft, eye, 0.4 * eye.distance, 1.1 * eye.distance)
        spot = np.clip(
            spot, (-x + radius, -y + radius, radius), (x - radius, y - radius, z - radius)
        )
        _put(draft, eye, spot, radius, pace)
    if draft.chance(0.3):
        material_name = glowing(draft, level * draft.log_uniform(1.0, 8.0))
        panel = (draft.uniform(-0.5, 0.5) * x, draft.uniform(-0.5, 0.5) * y, z - 0.05)
        draft.bodies.append(
            f'<geom type="box" size="{num(0.2 * x, 0.1 * y, 0.02)}" pos="{num(*panel)}" '
            f'material="{material_name}"/>'
        )
    # not through a wall
    reach = 0.8 * min(x - abs(place[0]), y - abs(place[1]), 0.5 * z)
    camera(draft, eye, 400.0, around=True, reach_m=reach)
    return eye, np.array([0.0, 0.0, 0.25 * z]), 0.6 * z


def _plane_axes(normal: tuple[int, int, int]) -> tuple[float, ...]:
    """x and y axes of a plane with this normal along an axis."""
    x, y, z = normal
    if z:
        return (1, 0, 0, 0, z, 0)
    # x upwards, so that y = normal cross x lies flat
    return (0, 0, 1, *np.cross((x, y, z), (0, 0, 1)))


def tabletop(draft: Draft, level: float) -> tuple[Eye, F64, float]:
    """Small things on a table under the sky; in a third of them things fall."""
    high = draft.uniform(0.2, 1.3)
    turn, back = draft.uniform(0.0, 2.0 * math.pi), draft.uniform(0.3, 1.2)
    place = np.array([back * math.cos(turn), back * math.sin(turn), high])
    target = np.array([draft.uniform(-0.1, 0.1), draft.uniform(-0.1, 0.1), 0.05])
    eye = Eye(place, target, draft.uniform(25.0, 60.0))
    scale = eye.focal_px / eye.distance
    falls = draft.chance(0.35)
    touch = 'contype="1" conaffinity="1"' if falls else ""
    material_name = material(draft, 4.0, scale, fine=0.3)
    draft.bodies.append(f'<geom type="plane" size="2 2 .1" material="{material_name}" {touch}/>')
    pace = draft.speed()
    for k in range(draft.integer(3, 12)):
        radius = draft.log_uniform(0.02, 0.12)
        spread = draft.rng.uniform(-0.35, 0.35, 2)
        if not falls or k % 3 == 0:
            _put(draft, eye, np.array([*spread, radius * draft.uniform(0.7, 3.0)]), radius, pace)
            continue
        body = material(draft, 2 * radius, scale, fine=0.3)
        kind = draft.choice(("box", "sphere", "ellipsoid", "cylinder", "capsule"))
        sizes = [radius * draft.uniform(0.4, 1.0) for _ in range(3)]
        # on a grid, so that none begins inside another
        spot = (0.3 * (k % 4) - 0.45, 0.3 * (k // 4) - 0.3, draft.uniform(0.15, 0.6))
        draft.velocity += [*draft.rng.normal(0.0, 0.3, 3), *draft.rng.normal(0.0, 8.0, 3)]
        draft.bodies.append(
            f'<body pos="{num(*spot)}"><freejoint/><geom type="{kind}" size="{num(*sizes)}" '
            f'material="{body}" density="500" {touch}/></body>'
        )
    if falls:
        draft.gravity = 9.81
        draft.tags.append("falling")
    if draft.chance(0.7):
        sky(draft, level * draft.log_uniform(0.05, 1.0))
    # gravity would pull down a camera without a spring, so it stands
    if falls:
        _standing_camera(draft, eye)
    else:
        camera(draft, eye, 160.0)
    return eye, target, draft.uniform(1.0, 2.5)


def _standing_camera(draft: Draft, eye: Eye) -> None:
    right, up, _ = eye.axes()
    draft.bodies.append(
        f'<camera name="eye" pos="{num(*eye.place)}" fovy="{num(eye.fovy_deg)}" '
        f'xyaxes="{num(*right, *up)}"/>'
    )
    draft.tags.append("camera still")


def floor(draft: Draft, level: float) -> tuple[Eye, F64, float]:
    """A floor without end and a sky; a few things on it; the view of a robot or a drone."""
    high, ahead = draft.log_uniform(0.15, 3.0), draft.uniform(0.5, 4.0)
    turn = draft.uniform(0.0, 2.0 * math.pi)
    eye = Eye(
        np.array([0.0, 0.0, high]),
        np.array([ahead * math.cos(turn), ahead * math.sin(turn), 0.0]),
        draft.uniform(35.0, 90.0),
    )
    material_name = material(
        draft, 1.0, eye.focal_px / eye.distance, fine=0.4, plain=0.1, contrast=1.2
    )
    # texture coordinates per metre
    draft.assets[-1] = draft.assets[-1].replace("<material ", '<material texuniform="true" ')
    draft.bodies.append(f'<geom type="plane" size="0 0 1" material="{material_name}"/>')
    pace = draft.speed()
    for _ in range(draft.integer(0, 7)):
        radius = draft.log_uniform(0.03, 0.4)
        spot = _ahead(draft, eye, 0.5 * eye.distance, 1.8 * eye.distance)
        spot[2] = max(radius, spot[2] * draft.uniform(0.0, 1.0))
        _put(draft, eye, spot, radius, pace)
    if draft.chance(0.85):
        sky(draft, level * draft.log_uniform(0.05, 1.0))
    camera(draft, eye, 250.0, around=True)
    return eye, eye.target, draft.uniform(3.0, 6.0)


def clutter(draft: Draft, level: float) -> tuple[Eye, F64, float]:
    """Many floating things in front of a wall or the sky."""
    eye = Eye(
        np.zeros(3), np.array([2.0, 0.0, draft.uniform(-0.5, 0.5)]), draft.uniform(30.0, 70.0)
    )
    if draft.chance(0.65):
        away = draft.uniform(3.0, 6.0)
        material_name = material(draft, 16.0, eye.focal_px / away, fine=0.25)
        draft.bodies.append(
            f'<geom type="plane" pos="{num(away, 0, 0)}" size="8 8 .1" '
            f'xyaxes="0 0 1 0 1 0" material="{material_name}"/>'
        )
    else:
        sky(draft, level * draft.log_uniform(0.05, 1.0))
    pace = draft.speed()
    for _ in range(draft.integer(8, 40)):
        radius = draft.log_uniform(0.02, 0.45)
        _put(draft, eye, _ahead(draft, eye, 0.8, 3.0, spread=1.0), radius, pace)
    camera(draft, eye, 150.0)
    return eye, np.array([1.5, 0.0, -0.5]), draft.uniform(2.0, 4.0)


def closeup(draft: Draft, level: float) -> tuple[Eye, F64, float]:
    """One textured surface fills the picture: flat, round or hilly; something may cross it."""
    away = draft.uniform(0.3, 1.0)
    eye = Eye(
        np.array([draft.uniform(-0.5, 0.5) * away, draft.uniform(-0.5, 0.5) * away, away]),
        np.zeros(3),
        draft.uniform(25.0, 55.0),
    )
    scale = eye.focal_px / eye.distance
    shape = draft.choice(("plane", "ball", "drum", "hills", "hull"))
    speed, spins = draft.speed(), draft.chance(0.6)
    if shape == "plane":
        material_name = material(
            draft, 6.0, scale, fine=0.5, plain=0.03, reflects=0.04, contrast=1.3
        )
        content, radius = f'<geom type="box" size="3 3 .1" material="{material_name}"/>', 0.2
        axis, depth = np.array([0.0, 0.0, 1.0]), -0.1
    elif shape == "hills":
        radius = 0.2
        material_name = material(
            draft, 2.0, scale, fine=0.5, plain=0.1, reflects=0.04, contrast=1.3
        )
        content, depth = _hills(draft, material_name), -0.15
        axis = np.array([0.0, 0.0, 1.0])
    else:
        radius = draft.uniform(0.3, 1.0)
        material_name = material(
            draft, 2 * radius, scale, fine=0.5, plain=0.05, reflects=0.06, contrast=1.3
        )
        axis, depth = draft.direction() * (1.0, 1.0, 0.2), -radius
        form = f'type="sphere" size="{num(radius)}"'
        if shape == "drum":
            form = f'type="cylinder" size="{num(radius, 2)}" zaxis="{num(*axis)}"'
        elif shape == "hull":
            form = f'type="mesh" mesh="{mesh(draft, radius)}"'
        content = f'<geom {form} material="{material_name}"/>'
    place = np.array([0.0, 0.0, depth])
    if spins:
        turn = min(speed / scale / radius, 400.0)
        draft.velocity.append(turn if draft.chance(0.5) else -turn)
        draft.speeds.append(speed)
        content = (
            '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
            f'<joint type="hinge" axis="{num(*axis)}"/>{content}'
        )
    draft.bodies.append(still(place, content))
    pace = draft.speed()
    for _ in range(draft.integer(0, 2)):
        _put(draft, eye, _ahead(draft, eye, 0.5 * away, 0.9 * away), 0.06 * away, pace)
    if draft.chance(0.4):
        sky(draft, level * draft.log_uniform(0.05, 1.0))
    draft.tags.append(shape)
    camera(draft, eye, 180.0)
    return eye, eye.target, draft.uniform(1.0, 2.5)


def _hills(draft: Draft, material_name: str) -> str:
    """A height field, 2 x 2 m."""
    side = draft.integer(8, 24)
    heights = draft.rng.uniform(0.0, 1.0, (side, side))
    heights = (heights + np.roll(heights, 1, 0) + np.roll(heights, 1, 1)) / 3.0
    name = draft.name("hills")
    draft.assets.append(
        f'<hfield name="{name}" nrow="{side}" ncol="{side}" '
        f'size="1 1 {num(draft.uniform(0.03, 0.3))} .02" elevation="{num(*heights.ravel())}"/>'
    )
    return f'<geom type="hfield" hfield="{name}" material="{material_name}"/>'
