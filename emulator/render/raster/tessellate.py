"""Shapes as triangles, for renderers that draw nothing else. numpy only.

Texture coordinates are those of the native caster (emulator/core/render/shading/texture.inl), at
the corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, F64, I32, Mesh, Shape, Surface

AROUND = 48
"""Segments of a circle: the polygon is at most 0.22 % of the radius inside of it."""

UNIT_CAPSULE = np.ones(3, np.float32)
"""Size of the capsule or cylinder that `stretched` stretches."""

RINGS = (1.0, 10.0, 100.0, 1e3)
"""An infinite plane reaches out in these steps, in units of the scene's extent."""


@dataclass(frozen=True)
class TriangleMesh:
    """The triangles of one geom, in its frame."""

    positions: F32
    """(n, 3) m"""
    normals: F32
    """(n, 3) outward, unit"""
    coordinates: F32
    """(n, 3) texture coordinates: (u, v, 0) with repeats counted, or the direction into a cube"""
    faces: I32
    """(m, 3) indices, counter-clockwise seen from outside"""


@dataclass(frozen=True)
class _Part:
    """A piece of a shape: corners, where they are on a unit shape, and their own u, v."""

    positions: F64
    normals: F64
    unit: F64
    uv: F64
    faces: I32


def tessellate(
    shape: Shape, size: F32, mesh: Mesh | None, surface: Surface, cube: bool, extent_m: float
) -> TriangleMesh:
    """Cut a geom into triangles.

    Args:
        shape: Of the geom.
        size: (3,) as SceneModel.geom_size.
        mesh: Of a MESH or HFIELD.
        surface: Of the geom.
        cube: Whether the surface's texture is a cube map.
        extent_m: The scene's, for infinite planes, m.
    """
    sizes = size.astype(np.float64)
    if mesh is not None:
        parts = [_mesh(mesh, sizes, surface, cube)]
    elif shape is Shape.PLANE:
        parts = [_plane(sizes, surface, extent_m)]
    elif shape is Shape.BOX:
        parts = _box(sizes)
    elif shape is Shape.CYLINDER:
        parts = [_barrel(sizes), _lid(sizes, 1.0), _lid(sizes, -1.0)]
    elif shape is Shape.CAPSULE:
        parts = [_cap(sizes, -1.0), _barrel(sizes), _cap(sizes, 1.0)]
    else:
        parts = [_ball(sizes[[0, 0, 0]] if shape is Shape.SPHERE else sizes)]

    if cube:
        coordinates = np.vstack([part.unit for part in parts])
        if surface.texuniform:
            coordinates = coordinates * _extents(shape, sizes)
    else:
        flat = np.vstack([part.uv for part in parts])
        if mesh is None and not (shape is Shape.PLANE and not (sizes[:2] > 0).all()):
            flat = (
                flat * _repeat(surface) * (_extents(shape, sizes)[:2] if surface.texuniform else 1)
            )
        coordinates = np.column_stack([flat, np.zeros(len(flat))])
    starts = np.cumsum([0] + [len(part.positions) for part in parts[:-1]])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return TriangleMesh(
        np.vstack([part.positions for part in parts]).astype(np.float32),
        np.vstack([part.normals for part in parts]).astype(np.float32),
        coordinates.astype(np.float32),
        np.vstack(faces).astype(np.int32),
    )


def stretched(capsule: TriangleMesh, size: F32) -> F32:
    """Stretch a capsule or cylinder to a size.

    Args:
        capsule: The unit shape, such as UNIT_CAPSULE.
        size: Radius and half length, m.

    Returns:
        (n, 3) its corners.
    """
    half = np.sign(capsule.positions[:, 2])
    corners = capsule.positions * size[0]
    corners[:, 2] += half * (size[1] - size[0])
    return np.asarray(corners, np.float32)


def sky_box(half_m: float) -> TriangleMesh:
    """A cube seen from inside, around the origin: where a sky is painted."""
    parts = _box(np.full(3, half_m))
    positions = np.vstack([part.positions for part in parts]).astype(np.float32)
    faces = np.vstack([part.faces[:, ::-1] + 4 * i for i, part in enumerate(parts)])
    inward = (-np.sign(positions) / 3**0.5).astype(np.float32)
    return TriangleMesh(positions, inward, positions, faces.astype(np.int32))


def _repeat(surface: Surface) -> F64:
    return np.array([r if r > 0 else 1.0 for r in surface.texrepeat])


def _extents(shape: Shape, size: F64) -> F64:
    """(3,) half widths along x, y, z as texuniform counts them."""
    radius = size[0]
    if shape is Shape.SPHERE:
        return np.array([radius, radius, radius])
    if shape in (Shape.CAPSULE, Shape.CYLINDER):
        return np.array([radius, radius, size[1]])
    return size


def _grid(rows: int, columns: int) -> I32:
    """Two triangles for each cell; corners are numbered row by row, rows upwards."""
    at = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
    right, above = at + 1, at + columns + 1
    first, second = (at, right, above + 1), (at, above + 1, above)
    return np.vstack([np.stack(first, 1), np.stack(second, 1)]).astype(np.int32)


def _revolve(
    radius: F64, normal_radius: F64, normal_z: F64, unit_radius: F64, unit_z: F64, z: F64
) -> _Part:
    """A profile turned around z; each input (k,) runs from the bottom to the top."""
    turn = np.linspace(0.0, 2 * np.pi, AROUND + 1)
    cosine, sine = np.cos(turn), np.sin(turn)

    def around(r: F64, height: F64) -> F64:
        x, y = r[:, None] * cosine, r[:, None] * sine
        return np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], -1).reshape(-1, 3)

    u = np.broadcast_to(turn / (2 * np.pi), (len(z), AROUND + 1)).reshape(-1)
    unit = around(unit_radius, unit_z)
    return _Part(
        around(radius, z),
        around(normal_radius, normal_z),
        unit,
        np.stack([u, 0.5 - 0.5 * unit[:, 2]], 1),
        _grid(len(z) - 1, AROUND),
    )


def _ball(size: F64) -> _Part:
    """An ellipsoid."""
    rise = np.linspace(-np.pi / 2, np.pi / 2, AROUND // 2 + 1)
    cosine, sine = np.maximum(np.cos(rise), 0), np.sin(rise)
    part = _revolve(cosine, cosine, sine, cosine, sine, sine)
    normals = part.unit / size
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # v runs with the elevation, not with the height
    v = 0.5 - np.repeat(rise, AROUND + 1) / np.pi
    uv = np.stack([part.uv[:, 0], v], 1)
    return _Part(part.unit * size, normals, part.unit, uv, part.faces)


def _barrel(size: F64) -> _Part:
    """The side of a cylinder or capsule."""
    one, none, ends = np.ones(2), np.zeros(2), np.array([-1.0, 1.0])
    return _revolve(size[0] * one, one, none, one, ends, size[1] * ends)


def _cap(size: F64, side: float) -> _Part:
    """Half a ball at an end of a capsule; side: 1 the upper, -1 the lower."""
    rise = np.linspace(0.0, np.pi / 2, AROUND // 4 + 1)
    rise = rise if side > 0 else -rise[::-1]
    cosine, sine = np.maximum(np.cos(rise), 0), np.sin(rise)
    height = side * size[1] + size[0] * sine
    part = _revolve(size[0] * cosine, cosine, sine, cosine, side + sine, height)
    # the image once more over each cap: down to the upper rim, and on from the lower
    v = np.repeat((1.0 if side > 0 else 0.0) - rise * (2 / np.pi), AROUND + 1)
    return replace(part, uv=np.stack([part.uv[:, 0], v], 1))


def _lid(size: F64, side: float) -> _Part:
    """An end of a cylinder."""
    turn = np.arange(AROUND) * (2 * np.pi / AROUND)
    rim = np.stack([np.cos(turn), np.sin(turn), np.full(AROUND, side)], 1)
    unit = np.vstack([[0.0, 0.0, side], rim])
    at = np.arange(AROUND)
    after = (at + 1) % AROUND
    faces = np.stack([np.zeros(AROUND, np.int64), at + 1, after + 1], 1)
    return _Part(
        unit * [size[0], size[0], size[1]],
        np.broadcast_to([0.0, 0.0, side], unit.shape),
        unit,
        0.5 + 0.5 * unit[:, :2],
        (faces if side > 0 else faces[:, ::-1]).astype(np.int32),
    )


def _box(size: F64) -> list[_Part]:
    """Six faces with corners of their own."""
    parts = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            # right and up as seen from outside
            right, up = (axis + 1) % 3, (axis + 2) % 3
            unit = np.zeros((4, 3))
            unit[:, axis] = side
            unit[:, right] = np.array([-1, 1, -1, 1]) * side
            unit[:, up] = [-1, -1, 1, 1]
            across = unit[:, 1] if axis == 0 else unit[:, 0]
            height = unit[:, 1] if axis == 2 else unit[:, 2]
            normals = np.zeros((4, 3))
            normals[:, axis] = side
            uv = np.stack([0.5 + 0.5 * across, 0.5 - 0.5 * height], 1)
            parts.append(_Part(unit * size, normals, unit, uv, _grid(1, 1)))
    return parts


def _steps(half: float, extent_m: float) -> F64:
    """Where a plane has corners along one axis."""
    if half > 0:
        return np.array([-half, half])
    out = np.array(RINGS) * extent_m
    return np.concatenate([-out[::-1], [0.0], out])


def _plane(size: F64, surface: Surface, extent_m: float) -> _Part:
    """A plane; infinite sides reach RINGS far, repeat every 2 m / texrepeat and ignore uniform."""
    columns, rows = (_steps(float(half), extent_m) for half in size[:2])
    x, y = (axis.reshape(-1) for axis in np.meshgrid(columns, rows))
    flat = np.stack([x, y, np.zeros_like(x)], 1)
    endless = not (size[:2] > 0).all()
    uv = np.zeros((len(x), 2))
    for axis, along in enumerate((x, -y)):
        half = size[axis]
        inside = along * (0.5 / half) + 0.5 if half > 0 else along * 0.5
        uv[:, axis] = inside * _repeat(surface)[axis] - 0.5 if endless else inside
    return _Part(
        flat,
        np.broadcast_to([0.0, 0.0, 1.0], flat.shape),
        flat,
        uv,
        _grid(len(rows) - 1, len(columns) - 1),
    )


def corners(values: npt.NDArray[np.floating], faces: I32) -> F64:
    """(3 nf, k) of (nv, k): every face has corners of its own."""
    return np.asarray(values, np.float64)[faces].reshape(-1, values.shape[1])


def _mesh(mesh: Mesh, size: F64, surface: Surface, cube: bool) -> _Part:
    """A mesh or height field."""
    positions = corners(mesh.vertices, mesh.faces)
    if mesh.normals is not None:
        normals = mesh.normals.reshape(-1, 3).astype(np.float64)
    else:
        a, b, c = positions.reshape(-1, 3, 3).transpose(1, 0, 2)
        normals = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(length > 0, length, 1.0)
    repeat = _repeat(surface)
    if mesh.texcoords is not None and not cube:
        spans = np.where(surface.texuniform & (size[:2] > 0), size[:2], 1.0)
        uv = mesh.texcoords.reshape(-1, 2).astype(np.float64) * repeat * spans
    else:
        uv = _object_linear(positions, size, surface, repeat)
    faces = np.arange(len(positions), dtype=np.int32).reshape(-1, 3)
    return _Part(positions, normals, positions, uv, faces)


def _object_linear(positions: F64, size: F64, surface: Surface, repeat: F64) -> F64:
    """(n, 2) u, v by position: the image spans the geom's size."""
    spans: Sequence[float] = [1.0 if surface.texuniform or s <= 0 else 1.0 / s for s in size[:2]]
    scale = 0.5 * repeat * np.array(spans) * [1.0, -1.0]
    return np.asarray(positions[:, :2] * scale - 0.5)
