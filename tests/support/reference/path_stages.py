"""Scenes of soft light and many bounces, one for each thing that `path` can do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import LightKind, Shape, Surface, Texture, TextureKind
from reference.stage import Builder, Stage, Vector, matt, matt_rgb, turned
from reference.tessellation import ball, waves

F64 = npt.NDArray[np.float64]

# per face (+X -X +Y -Y +Z -Z of OpenGL): the directions of the middle, of u and of v
FACES = np.array(
    [
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, -1]],
        [[0, 0, 1], [1, 0, 0], [0, -1, 0]],
        [[0, 0, -1], [-1, 0, 0], [0, -1, 0]],
    ],
    np.float64,
)
# OpenGL's y is up: (x, y, z) of the box is (x, z, -y) of the world
WORLD_TO_BOX = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float64)

DARK = (0.0, 0.0, 0.0)
DOWN = np.diag([1.0, -1.0, -1.0])


def _look(made: Builder, eye: Vector, at: Vector, bounces: int, **more: Any) -> Stage:
    return made.look(eye, at, bounces=bounces, path=True, **more)


def _things(made: Builder) -> None:
    """A floor, a ball and a box, of three colours."""
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt_rgb((0.6, 0.5, 0.3)))
    made.add(Shape.SPHERE, (0.4,), (-0.5, 0, 0.4), matt_rgb((0.8, 0.2, 0.2)))
    turn = turned((0, 0, 1), 25)
    made.add(Shape.BOX, (0.3, 0.2, 0.3), (0.5, 0.2, 0.3), matt_rgb((0.2, 0.4, 0.8)), turn=turn)


def sun() -> Stage:
    """Hard light and one bounce off coloured things."""
    made = Builder()
    _things(made)
    made.shine(
        LightKind.DIRECTIONAL, towards=(0.5, 0.3, -1.0), diffuse=(0.9, 0.8, 0.6), bulbradius_m=0.0
    )
    return _look(made, (0.3, -3.0, 1.8), (0, 0, 0.2), 1)


def bare_bulb() -> Stage:
    """A point without a size, and two bounces."""
    made = Builder()
    _things(made)
    made.shine(LightKind.POINT, (0.6, -1.0, 2.0), diffuse=(4.0, 4.0, 4.0), bulbradius_m=0.0)
    return _look(made, (0.3, -3.0, 1.8), (0, 0, 0.2), 2)


def cone() -> Stage:
    """A spot with a hard edge, and one bounce."""
    made = Builder()
    _things(made)
    made.shine(
        LightKind.SPOT,
        (1.0, -1.0, 2.2),
        (-1.2, 1.0, -2.0),
        cutoff_deg=18.0,
        diffuse=(5.0, 5.0, 5.0),
        bulbradius_m=0.0,
    )
    return _look(made, (0.3, -2.6, 1.8), (-0.2, 0, 0.2), 1)


def bulb() -> Stage:
    """Soft shadows of a lamp that is a ball."""
    made = Builder()
    _things(made)
    made.shine(LightKind.POINT, (0.6, -1.0, 2.0), diffuse=(4.0, 4.0, 4.0), bulbradius_m=0.35)
    return _look(made, (0.3, -2.4, 1.2), (0, 0, 0.2), 0)


def panel() -> Stage:
    """A glowing rectangle near a wall, seen, and the shadow in its light."""
    made = Builder()
    _things(made)
    made.add(Shape.PLANE, (3, 3, 1), (0, 1.2, 1), matt(0.7), turn=turned((1, 0, 0), 90))
    glow = matt_rgb((0.8, 0.9, 0.7), emission=4.0)
    made.add(Shape.PLANE, (0.6, 0.3, 1), (0.2, 0.8, 1.4), glow, turn=turned((1, 0, 0), 150))
    return _look(made, (0.3, -2.8, 1.3), (0, 0.2, 0.6), 0)


def embers() -> Stage:
    """Glowing things of four shapes, one of them touching the floor, and a bounce."""
    made = Builder()
    _things(made)
    glow = matt_rgb((0.9, 0.5, 0.2), emission=3.0)
    made.add(Shape.SPHERE, (0.15,), (0.0, -0.7, 0.15), glow)
    made.add(Shape.BOX, (0.1, 0.15, 0.05), (0.9, -0.5, 0.4), glow, turn=turned((1, 1, 0), 40))
    made.add(Shape.CYLINDER, (0.08, 0.3), (-0.9, -0.5, 0.5), glow, turn=turned((1, 0, 0), 30))
    size = (0.15, 0.1, 0.2)
    made.add(Shape.MESH, (1, 1, 1), (-0.1, 0.3, 1.1), glow, mesh=ball(6, size, smooth=False))
    return _look(made, (0.3, -3.0, 1.8), (0, 0, 0.3), 1)


def dome() -> Stage:
    """A cloudy sky: what the lights' ambient adds up to comes from all sides."""
    made = Builder()
    _things(made)
    for ambient in ((0.3, 0.2, 0.1), (0.2, 0.4, 0.6)):
        made.shine(LightKind.DIRECTIONAL, diffuse=DARK, ambient=ambient)
    # the floor goes on to the horizon, which is not in the picture
    return _look(made, (0.3, -2.2, 2.2), (0, 0, 0.2), 2)


def _glow(direction: F64) -> F64:
    """A sky with a glow on one side."""
    x, y, z = np.moveaxis(direction, -1, 0)
    glow = np.exp(4 * (0.6 * x - 0.6 * y + 0.53 * z - 1))
    return np.stack([0.2 + 0.8 * glow, 0.3 + 0.2 * z + 0.4 * glow, 0.5 + 0.4 * z], -1)


def _sunset(direction: F64) -> F64:
    """A dark sky whose light comes from a glow on one side."""
    x, y, z = np.moveaxis(direction, -1, 0)
    glow = np.exp(12 * (0.6 * x - 0.6 * y + 0.53 * z - 1))
    return np.stack([0.05 + 0.9 * glow, 0.05 + 0.7 * glow, 0.1 + 0.4 * glow], -1)


def _under(
    colour: Callable[[F64], F64], width: int, made: Builder, eye: Vector, at: Vector
) -> Stage:
    """Things under a skybox, with one bounce."""
    made.textures = [skybox(colour, width)]
    made.skybox = 0
    return _look(made, eye, at, 1, sky_radiance=radiance_of(made.textures[0]))


def sky() -> Stage:
    """A skybox with a glow on one side, seen and lighting."""
    made = Builder()
    _things(made)
    return _under(_glow, 4, made, (0.3, -3.0, 0.8), (0, 0, 0.5))


def sunset() -> Stage:
    """A skybox that is bright on one side alone, to which rays are sent."""
    made = Builder()
    _things(made)
    return _under(_sunset, 8, made, (0.3, -3.0, 0.8), (0, 0, 0.5))


def mirror() -> Stage:
    """A mirror on the floor and a mirror ball, which see each other."""
    made = Builder()
    made.add(Shape.PLANE, (6, 6, 1), (0, 0, 0), matt(0.5, reflectance=0.4))
    made.add(Shape.SPHERE, (0.4,), (-0.5, 0, 0.45), matt(0.3, reflectance=0.7))
    made.add(Shape.BOX, (0.3, 0.2, 0.3), (0.5, 0.2, 0.3), matt_rgb((0.2, 0.4, 0.8)))
    # a lamp without a size: ours are not seen in mirrors
    made.shine(LightKind.POINT, (0.9, -1.0, 2.0), diffuse=(4.0, 4.0, 4.0), bulbradius_m=0.0)
    return _look(made, (0.3, -3.0, 1.4), (0, 0, 0.3), 3)


def faint_mirror() -> Stage:
    """A dark floor that mirrors a fifth of a bright sky, as in dm_control."""
    made = Builder()
    made.add(Shape.PLANE, (6, 6, 1), (0, 0, 0), matt(0.3, reflectance=0.2))
    made.add(Shape.SPHERE, (0.4,), (-0.5, 0, 0.45), matt(0.3))
    made.add(Shape.BOX, (0.3, 0.2, 0.3), (0.5, 0.2, 0.3), matt_rgb((0.2, 0.4, 0.8)))
    return _under(_glow, 4, made, (0.3, -3.0, 1.4), (0, 0, 0.3))


def glossy() -> Stage:
    """Classic materials from dull to shining, under a panel that they show."""
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(0.2, specular=1.0, shininess=0.3))
    for x, shininess in ((-0.7, 0.02), (0.0, 0.2), (0.7, 0.9)):
        look = matt_rgb((0.3, 0.1, 0.1), specular=0.9, shininess=shininess)
        made.add(Shape.SPHERE, (0.3,), (x, 0, 0.3), look)
    glow = matt(1.0, emission=6.0)
    made.add(Shape.PLANE, (0.9, 0.2, 1), (0, -0.2, 1.7), glow, turn=turned((1, 0, 0), 170))
    return _look(made, (0.0, -2.6, 1.3), (0, 0, 0.3), 1)


def metals() -> Stage:
    """Physical materials: gold and plastic, polished and rough, in the light of two panels."""
    made = Builder()
    rough = matt_rgb((0.3, 0.35, 0.4), metallic=0.0, roughness=0.6)
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), rough)
    for x, metallic, roughness in ((-0.9, 1, 0.2), (-0.3, 1, 0.6), (0.3, 0, 0.3), (0.9, 0.5, 0.4)):
        look = matt_rgb((0.9, 0.6, 0.2), metallic=float(metallic), roughness=roughness)
        made.add(Shape.SPHERE, (0.28,), (x, 0, 0.28), look)
    for x, colour in ((-0.8, (1.0, 0.9, 0.8)), (0.9, (0.5, 0.7, 1.0))):
        glow = matt_rgb(colour, emission=6.0)
        turn = turned((1, 0, 0), 170)
        made.add(Shape.PLANE, (0.5, 0.2, 1), (x, -0.3, 1.6), glow, turn=turn)
    return _look(made, (0.0, -2.8, 1.2), (0, 0, 0.3), 1)


def metal_bulb() -> Stage:
    """Physical materials in the light of a bulb, which is wider than their narrowest lobes."""
    made = Builder()
    rough = matt_rgb((0.3, 0.35, 0.4), metallic=0.0, roughness=0.6)
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), rough)
    for x, metallic, roughness in ((-0.9, 1, 0.1), (-0.3, 1, 0.2), (0.3, 0, 0.15), (0.9, 1, 1)):
        look = matt_rgb((0.9, 0.6, 0.2), metallic=float(metallic), roughness=float(roughness))
        made.add(Shape.SPHERE, (0.28,), (x, 0, 0.28), look)
    # behind the eye; the floor fills the picture, so that no pixel is nearly black
    made.shine(LightKind.POINT, (1.0, -2.5, 2.6), diffuse=(9.0, 9.0, 9.0), bulbradius_m=0.6)
    return _look(made, (0.0, -2.2, 2.0), (0, 0, 0.2), 0)


def tiles() -> Stage:
    """A checker whose texels are wider than pixels, its colours on a ball beside it."""
    made = Builder()
    checks = np.zeros((6, 6, 3), np.uint8) + [30, 60, 160]
    checks[(np.add.outer(np.arange(6), np.arange(6)) % 2) == 0] = [240, 200, 120]
    made.textures = [Texture(TextureKind.FLAT, checks.astype(np.uint8))]
    look = Surface((1.0, 1.0, 0.9, 1.0), texture=0, specular=0.0)
    made.add(Shape.PLANE, (1.8, 1.8, 1), (0, 0, 0), look)
    made.add(Shape.SPHERE, (0.5,), (0, 0.2, 0.5), matt(0.9))
    made.shine(LightKind.POINT, (0.9, -1.0, 2.0), diffuse=(4.0, 4.0, 4.0), bulbradius_m=0.3)
    return _look(made, (0.2, -2.4, 1.6), (0, 0.1, 0.3), 2)


def room() -> Stage:
    """A closed room of coloured walls, a panel in the ceiling, two boxes, eight bounces."""
    made = Builder()
    white = matt(0.75)
    half = 1.0
    walls: tuple[tuple[Vector, Any, Surface], ...] = (
        ((0, 0, 0), np.eye(3), white),
        ((0, 0, 2), DOWN, white),
        ((0, half, 1), turned((1, 0, 0), 90), white),
        ((0, -half, 1), turned((1, 0, 0), -90), white),
        ((-half, 0, 1), turned((0, 1, 0), 90), matt_rgb((0.6, 0.05, 0.05))),
        ((half, 0, 1), turned((0, 1, 0), -90), matt_rgb((0.1, 0.5, 0.1))),
    )
    for pos, turn, look in walls:
        # wider than the room: no gap in the corners
        made.add(Shape.PLANE, (half + 0.01, half + 0.01, 1), pos, look, turn=turn)
    made.add(Shape.PLANE, (0.35, 0.3, 1), (0, 0, 1.9995), matt(0.5, emission=14.0), turn=DOWN)
    made.add(Shape.BOX, (0.28, 0.28, 0.3), (0.35, -0.1, 0.3), white, turn=turned((0, 0, 1), 18))
    made.add(Shape.BOX, (0.28, 0.28, 0.6), (-0.35, 0.35, 0.6), white, turn=turned((0, 0, 1), -20))
    return _look(made, (0.0, -0.97, 1.0), (0, 0.5, 0.95), 8, fovy_deg=75.0)


def swell() -> Stage:
    """A coarse mesh with smooth normals in the light of a panel."""
    made = Builder()
    made.add(Shape.MESH, (1, 1, 1), (0, 0, 0), matt(0.8), mesh=waves(1.5, 0.12, 25))
    glow = matt(1.0, emission=5.0)
    made.add(Shape.PLANE, (0.6, 0.6, 1), (0.8, 0.6, 1.6), glow, turn=turned((1, -1, 0), 155))
    return _look(made, (0.0, -1.6, 2.4), (0, 0, 0.0), 0)


def glass() -> Stage:
    """Panes of coloured glass in front of things, and lamps on both sides of them.

    Ours let everything pass from behind, Mitsuba's do not: so no light that is seen goes that way.
    """
    made = Builder()
    _things(made)
    upright = turned((1, 0, 0), 90)
    for x, alpha in ((-0.55, 0.3), (0.45, 0.7)):
        pane = matt_rgb((0.7, 0.7, 0.2))
        made.add(
            Shape.PLANE,
            (0.4, 0.5, 1),
            (x, -0.7, 0.55),
            replace(pane, rgba=(*pane.rgba[:3], alpha)),
            turn=upright,
        )
    made.shine(LightKind.POINT, (0.2, 1.6, 1.8), diffuse=(3.0, 3.0, 3.0), bulbradius_m=0.2)
    for x in (-0.55, 0.45):
        # from below at a pane, and beyond it over everything
        spot = (x, -1.2, 0.02)
        made.shine(
            LightKind.SPOT,
            spot,
            (0, 0.5, 0.53),
            cutoff_deg=10,
            diffuse=(0.2, 0.3, 0.2),
            bulbradius_m=0.0,
        )
    return _look(made, (0.2, -3.0, 1.4), (0, -0.3, 0.2), 0)


PATH_STAGES = {
    "sun": sun,
    "bare_bulb": bare_bulb,
    "cone": cone,
    "bulb": bulb,
    "panel": panel,
    "embers": embers,
    "dome": dome,
    "sky": sky,
    "sunset": sunset,
    "mirror": mirror,
    "faint_mirror": faint_mirror,
    "glossy": glossy,
    "metals": metals,
    "metal_bulb": metal_bulb,
    "tiles": tiles,
    "room": room,
    "swell": swell,
    "glass": glass,
}


def mitsuba_integrator(name: str) -> str:
    """Which of Mitsuba's lights a stage: through what is transparent, only that for volumes."""
    return "volpath" if name == "glass" else "path"


def skybox(colour: Callable[[F64], F64], width: int) -> Texture:
    """A skybox of colour(world directions (..., 3)) -> (..., 3) linear, 0 ... 1."""
    at = (np.arange(width) + 0.5) / width * 2 - 1
    u, v = np.meshgrid(at, at)
    box = FACES[:, 0, None, None] + sum(
        FACES[:, k, None, None] * w[None, :, :, None] for k, w in ((1, u), (2, v))
    )
    light = colour(box / np.linalg.norm(box, axis=-1, keepdims=True) @ WORLD_TO_BOX)
    return Texture(TextureKind.SKYBOX, np.round(255 * light).astype(np.uint8), srgb=False)


def radiance_of(texture: Texture) -> Callable[[F64], F64]:
    """What the skybox shows in world directions: between texels bilinear, at edges clamped."""
    data = texture.data[..., :3] / 255.0
    width = data.shape[1]

    def radiance(direction: F64) -> F64:
        d = direction @ WORLD_TO_BOX.T
        face = np.argmax(d @ FACES[:, 0].T, axis=-1)
        middle, along_u, along_v = (np.sum(d * FACES[face, k], -1) for k in range(3))
        x = np.clip((along_u / middle + 1) / 2 * width - 0.5, 0, width - 1)
        y = np.clip((along_v / middle + 1) / 2 * width - 0.5, 0, width - 1)
        column = np.minimum(x.astype(int), width - 2)
        row = np.minimum(y.astype(int), width - 2)
        fx, fy = (x - column)[..., None], (y - row)[..., None]
        top = data[face, row, column] * (1 - fx) + data[face, row, column + 1] * fx
        bottom = data[face, row + 1, column] * (1 - fx) + data[face, row + 1, column + 1] * fx
        return np.asarray(top * (1 - fy) + bottom * fy)

    return radiance
