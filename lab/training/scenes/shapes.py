"""Shapes: primitives and meshes, as geoms of a body."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64
from evs_lab.training.scenes.draft import Draft, num

I64 = npt.NDArray[np.int64]

PRIMITIVES = ("sphere", "capsule", "cylinder", "box", "ellipsoid")
MESHES = ("hull", "knob", "star")


def thing(draft: Draft, radius: float, material_name: str) -> str:
    """One or a few geoms that fill about a ball of this radius around the body's origin."""
    if draft.chance(0.25):
        parts = draft.integer(2, 4)
        spread = 0.6 * radius
        return "".join(
            _one(draft, radius * draft.uniform(0.3, 0.6), material_name, draft.direction() * spread)
            for _ in range(parts)
        )
    return _one(draft, radius, material_name, np.zeros(3))


def _one(draft: Draft, radius: float, material_name: str, place: F64) -> str:
    common = f'material="{material_name}" pos="{num(*place)}" zaxis="{num(*draft.direction())}"'
    if draft.chance(0.35):
        return f'<geom type="mesh" mesh="{mesh(draft, radius)}" {common}/>'
    kind = draft.choice(PRIMITIVES)
    thick = [radius * draft.log_uniform(0.15, 1.0) for _ in range(3)]
    sizes = {
        "sphere": (radius,),
        "capsule": (thick[0] * 0.5, 0.8 * radius),
        "cylinder": (thick[0], radius * draft.uniform(0.1, 1.0)),
        "box": (thick[0], thick[1], radius),
        "ellipsoid": (thick[0], thick[1], radius),
    }
    return f'<geom type="{kind}" size="{num(*sizes[kind])}" {common}/>'


def mesh(draft: Draft, radius: float) -> str:
    """Add a mesh of about this radius; return its name."""
    name, kind = draft.name("mesh"), draft.choice(MESHES)
    if kind == "hull":
        # MuJoCo takes the convex hull where no faces are given
        points = draft.rng.normal(size=(draft.integer(6, 24), 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        points *= radius * draft.rng.uniform(0.6, 1.0, (len(points), 1))
        draft.assets.append(f'<mesh name="{name}" vertex="{num(*points.ravel())}"/>')
        return name
    vertices, faces = _knob(draft, radius) if kind == "knob" else _star(draft, radius)
    smooth = "true" if kind == "knob" else "false"
    draft.assets.append(
        f'<mesh name="{name}" smoothnormal="{smooth}" inertia="shell" '
        f'vertex="{num(*vertices.ravel())}" face="{" ".join(map(str, faces.ravel()))}"/>'
    )
    return name


def _knob(draft: Draft, radius: float) -> tuple[F64, I64]:
    """A ball with dents: rings of vertices between two poles."""
    rings, around = draft.integer(4, 9), draft.integer(6, 14)
    vertices = [(0.0, 0.0, 1.0)]
    for ring in range(1, rings + 1):
        polar = math.pi * ring / (rings + 1)
        for k in range(around):
            turn = 2.0 * math.pi * k / around
            dent = draft.uniform(0.7, 1.0)
            flat = dent * math.sin(polar)
            vertices.append((flat * math.cos(turn), flat * math.sin(turn), dent * math.cos(polar)))
    vertices.append((0.0, 0.0, -1.0))
    last = len(vertices) - 1
    faces = []
    for k in range(around):
        after = (k + 1) % around
        faces.append((0, 1 + k, 1 + after))
        faces.append((last, last - around + after, last - around + k))
        for ring in range(rings - 1):
            upper, lower = 1 + ring * around, 1 + (ring + 1) * around
            faces.append((upper + k, lower + k, lower + after))
            faces.append((upper + k, lower + after, upper + after))
    return radius * np.array(vertices), np.array(faces)


def _star(draft: Draft, radius: float) -> tuple[F64, I64]:
    """A flat star or cog with sharp corners."""
    corners = 2 * draft.integer(3, 12)
    inner, half = draft.uniform(0.3, 0.9), draft.uniform(0.05, 0.4)
    rim = [
        (
            (1.0 if k % 2 else inner) * math.cos(2.0 * math.pi * k / corners),
            (1.0 if k % 2 else inner) * math.sin(2.0 * math.pi * k / corners),
        )
        for k in range(corners)
    ]
    vertices = [(0.0, 0.0, half), (0.0, 0.0, -half)]
    vertices += [(x, y, z) for z in (half, -half) for x, y in rim]
    faces = []
    for k in range(corners):
        top, top_after = 2 + k, 2 + (k + 1) % corners
        low, low_after = top + corners, top_after + corners
        faces += [(0, top, top_after), (1, low_after, low)]
        faces += [(top, low, low_after), (top, low_after, top_after)]
    return radius * np.array(vertices), np.array(faces)
