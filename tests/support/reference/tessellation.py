"""Meshes for comparisons: what other programs lack as a shape, and curved meshes of our own."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import Mesh


def ball(rows: int, size: npt.ArrayLike, smooth: bool = True) -> Mesh:
    """An ellipsoid of 4 rows^2 triangles, with the ellipsoid's own normals where smooth."""
    tall, around = np.linspace(0, np.pi, rows + 1), np.pi * np.arange(2 * rows + 1) / rows
    a, b = np.meshgrid(tall, around, indexing="ij")
    unit = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], -1).reshape(-1, 3)
    index = np.arange(len(unit)).reshape(rows + 1, 2 * rows + 1)
    p, q, r, s = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([p, s, r], -1), np.stack([p, r, q], -1)]).reshape(-1, 3)
    vertices = unit * np.asarray(size, np.float64)
    # at the poles two corners meet
    edges = unit[faces][:, 1:] - unit[faces][:, :1]
    faces = faces[np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1) > 1e-12]
    normals = unit / np.asarray(size, np.float64)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corners = normals[faces].astype(np.float32) if smooth else None
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), corners)


def sheet(size: tuple[float, float], repeat: tuple[float, float]) -> Mesh:
    """A rectangle in z = 0 that faces +z, with texture coordinates from (0, 0) to `repeat`."""
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    vertices = np.concatenate([corner * size, np.zeros((4, 1))], axis=1)
    coordinates = (corner + 1) / 2 * repeat
    return Mesh(vertices.astype(np.float32), faces, None, coordinates[faces].astype(np.float32))


def waves(half: float, height: float, steps: int) -> Mesh:
    """A sheet that faces +z in waves of this height, coarse, with the waves' own normals."""
    x, y = np.meshgrid(np.linspace(-half, half, steps), np.linspace(-half, half, steps))
    a, b = 1.5 * np.pi / half * x, 1.0 * np.pi / half * y
    vertices = np.stack([x, y, height * np.sin(a) * np.cos(b)], -1).reshape(-1, 3)
    slope = height * np.pi / half
    normals = np.stack(
        [-1.5 * slope * np.cos(a) * np.cos(b), slope * np.sin(a) * np.sin(b), np.ones_like(a)], -1
    ).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    index = np.arange(steps * steps).reshape(steps, steps)
    p, q, r, s = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([p, q, r], -1), np.stack([p, r, s], -1)]).reshape(-1, 3)
    return Mesh(
        vertices.astype(np.float32), faces.astype(np.int32), normals[faces].astype(np.float32)
    )


def soup(seed: int) -> Mesh:
    """Triangles of any size and direction."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (120, 1, 3)) + rng.normal(size=(120, 3, 3)) * 0.2
    faces = np.arange(360).reshape(120, 3)
    return Mesh(corners.reshape(-1, 3).astype(np.float32), faces.astype(np.int32))
