"""Scenes of hard light on Lambert surfaces without a bounce: what `direct` can do exactly."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import LightKind, Shape, Surface, Texture, TextureKind
from reference.stage import Builder, Stage, matt, matt_rgb, turned
from reference.tessellation import ball, sheet, waves


def _floor(builder: Builder) -> None:
    builder.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(0.6))


def point() -> Stage:
    """A ball and a box under a bare bulb."""
    made = Builder()
    _floor(made)
    made.add(Shape.SPHERE, (0.4,), (-0.5, 0, 0.4), matt(0.8))
    made.add(Shape.BOX, (0.3, 0.2, 0.25), (0.5, 0.2, 0.25), matt(0.3), turn=turned((0, 0, 1), 25))
    made.shine(LightKind.POINT, (0.6, -1.0, 2.0), diffuse=(4.0, 4.0, 4.0))
    return made.look((0.3, -3.0, 1.8), (0, 0, 0.2))


def directional() -> Stage:
    """Every shape of ours in the sun."""
    made = Builder()
    _floor(made)
    tilt = turned((1, 1, 0), 35)
    made.add(Shape.SPHERE, (0.25,), (-0.9, 0.3, 0.4), matt(0.8))
    made.add(Shape.CAPSULE, (0.15, 0.3), (-0.4, -0.3, 0.4), matt(0.7), turn=tilt)
    made.add(Shape.CYLINDER, (0.2, 0.3), (0.2, 0.4, 0.45), matt(0.6), turn=turned((0, 1, 0), 50))
    made.add(Shape.ELLIPSOID, (0.3, 0.15, 0.2), (0.3, -0.5, 0.4), matt(0.75), turn=tilt)
    made.add(Shape.BOX, (0.2, 0.25, 0.15), (0.9, 0.2, 0.35), matt(0.5), turn=tilt)
    made.shine(LightKind.DIRECTIONAL, towards=(0.5, 0.3, -1.0), diffuse=(0.8, 0.8, 0.8))
    return made.look((0.2, -3.2, 2.0), (0, 0, 0.3), fovy_deg=38)


def spot() -> Stage:
    """The edge of a cone across a floor and a cylinder; the principal point is off the centre."""
    made = Builder()
    _floor(made)
    made.add(Shape.CYLINDER, (0.25, 0.3), (0.2, 0.1, 0.3), matt(0.8))
    made.shine(
        LightKind.SPOT,
        (1.0, -1.0, 2.2),
        (-0.8, 1.0, -2.0),
        cutoff_deg=18.0,
        diffuse=(5.0, 5.0, 5.0),
    )
    return made.look((-0.4, -2.6, 1.9), (0.1, 0, 0.1), principal=(19.0, 21.0))


def candela() -> Stage:
    """A lamp of so many candela and a coloured sun, on coloured things, without perspective."""
    made = Builder()
    made.add(Shape.PLANE, (1.4, 1.0, 1), (0, 0, 0), matt_rgb((0.7, 0.4, 0.2)))
    made.add(Shape.ELLIPSOID, (0.5, 0.3, 0.25), (0.2, 0.1, 0.3), matt_rgb((0.1, 0.6, 0.3)))
    made.shine(LightKind.POINT, (0.9, 0.6, 1.5), diffuse=(1, 1, 1), intensity=2500.0, range_m=0.0)
    made.shine(LightKind.DIRECTIONAL, towards=(-0.4, 0.5, -1), diffuse=(0.2, 0.5, 0.9))
    return made.look((0.3, -1.0, 2.0), (0, 0, 0), fovy_deg=2.4, orthographic=True)


def glow() -> Stage:
    """Things that shine of themselves, and one that does not: `direct` lights nothing with them."""
    made = Builder()
    made.add(Shape.PLANE, (2, 2, 1), (0, 0, 0), matt_rgb((0.9, 0.5, 0.2), emission=0.4))
    made.add(Shape.SPHERE, (0.4,), (0.3, 0, 0.5), matt_rgb((0.2, 0.5, 0.9), emission=1.5))
    made.add(Shape.BOX, (0.2, 0.3, 0.3), (-0.6, 0, 0.3), matt(0.5))
    return made.look((0.0, -3.0, 1.8), (0, 0, 0.3), bounces=-1)


def checker() -> Stage:
    """A checker whose texels are wider than pixels, on a plane and by a mesh's (u, v)."""
    made = Builder()
    tiles = np.zeros((6, 4, 3), np.uint8) + [40, 90, 160]
    tiles[(np.add.outer(np.arange(6), np.arange(4)) % 2) == 0] = [230, 200, 150]
    tiles[0, 0] = [255, 30, 30]
    made.textures = [
        Texture(TextureKind.FLAT, tiles.astype(np.uint8)),
        Texture(TextureKind.FLAT, tiles.astype(np.uint8), srgb=False),
    ]
    plain = Surface((0.9, 0.95, 0.8, 1.0), texture=0, specular=0.0, texrepeat=(1.5, 1.0))
    made.add(Shape.PLANE, (1.5, 1.2, 1), (-0.3, 0, 0), plain)
    wall = sheet((0.8, 0.6), (2.0, 1.0))
    turn = turned((0, 0, 1), -20) @ turned((1, 0, 0), 90)
    made.add(
        Shape.MESH,
        (1, 1, 1),
        (0.2, 0.9, 0.7),
        Surface((1, 1, 1, 1), texture=1, specular=0.0),
        turn=turn,
        mesh=wall,
    )
    made.shine(LightKind.DIRECTIONAL, towards=(0.3, 0.6, -1.0), diffuse=(0.9, 0.9, 0.9))
    return made.look((0.2, -1.8, 1.4), (0, 0.2, 0.2))


def mesh() -> Stage:
    """A coarse mesh with smooth normals, and one with its facets' own.

    The smooth one never turns away from the camera: there we mirror a normal, Mitsuba is black.
    """
    made = Builder()
    made.add(Shape.MESH, (1, 1, 1), (0, 0, 0), matt(0.8), mesh=waves(1.5, 0.15, 25))
    made.add(
        Shape.MESH,
        (1, 1, 1),
        (0.2, 0.1, 0.55),
        matt(0.8),
        mesh=ball(4, (0.4, 0.4, 0.4), smooth=False),
        turn=turned((1, 0, 1), 40),
    )
    made.shine(LightKind.POINT, (0.3, -1.5, 2.0), diffuse=(4.0, 4.0, 4.0))
    return made.look((0.0, -1.8, 2.6), (0, 0, 0.1))


DIRECT_STAGES = {
    "point": point,
    "directional": directional,
    "spot": spot,
    "candela": candela,
    "glow": glow,
    "checker": checker,
    "mesh": mesh,
}
