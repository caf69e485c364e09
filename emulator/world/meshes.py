"""Triangles of a model: its meshes with the normals that MuJoCo shows, and its height fields."""

from __future__ import annotations

import mujoco
import numpy as np

from evs.emulator.base.scene import F32, F64, I32, Mesh
from evs.emulator.world.model import name_of
from evs.emulator.world.model_edits import Array
from evs.msgs import EvsError

SMOOTH_COSINE = 0.8
"""Cosine to the face's normal from which on a corner keeps its own, without texture coordinates."""


def mesh_arrays(model: mujoco.MjModel, mesh: int) -> tuple[tuple[int, ...], list[Array]]:
    """What extract_mesh makes it of: a few numbers, and the model's own memory."""
    vertices = _rows(model.mesh_vertadr[mesh], model.mesh_vertnum[mesh])
    faces = _rows(model.mesh_faceadr[mesh], model.mesh_facenum[mesh])
    normals = _rows(model.mesh_normaladr[mesh], model.mesh_normalnum[mesh])
    texcoords = slice(0, 0)
    if model.mesh_texcoordadr[mesh] >= 0:
        texcoords = _rows(model.mesh_texcoordadr[mesh], model.mesh_texcoordnum[mesh])
    places = (vertices, faces, normals, texcoords)
    return tuple(end for place in places for end in (place.start, place.stop)), [
        model.mesh_vert[vertices],
        model.mesh_face[faces],
        model.mesh_facenormal[faces],
        model.mesh_facetexcoord[faces],
        model.mesh_normal[normals],
        model.mesh_texcoord[texcoords],
    ]


def height_field_arrays(model: mujoco.MjModel, field: int) -> tuple[tuple[float, ...], list[Array]]:
    """What extract_height_field makes it of: a few numbers, and the model's own memory."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    heights = _rows(model.hfield_adr[field], rows * columns)
    numbers = (rows, columns, heights.start, *(float(v) for v in model.hfield_size[field]))
    return numbers, [model.hfield_data[heights]]


def _rows(first: int, count: int) -> slice:
    return slice(int(first), int(first) + int(count))


def extract_mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    """One mesh of the model, in the frame of the geoms that use it. EvsError: not finite."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = np.array(model.mesh_vert[first : first + count], np.float32)
    _check_finite(vertices, "mesh", name_of(model, mujoco.mjtObj.mjOBJ_MESH, mesh))
    chosen = slice(
        model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + int(model.mesh_facenum[mesh])
    )
    faces = np.array(model.mesh_face[chosen], np.int32)

    # the normal of each face's corner: (nf, 3, 3)
    flat = face_normals(vertices, faces)[:, None, :]
    corner = model.mesh_normal[model.mesh_facenormal[chosen] + model.mesh_normaladr[mesh]]
    corner = _unit(np.asarray(corner, np.float64), flat)
    texcoords = None
    if model.mesh_texcoordadr[mesh] >= 0:
        index = model.mesh_facetexcoord[chosen] + model.mesh_texcoordadr[mesh]
        texcoords = np.array(model.mesh_texcoord[index], np.float32)
    else:
        smooth = (corner * flat).sum(-1, keepdims=True) >= SMOOTH_COSINE
        corner = np.where(smooth, corner, flat)
    return Mesh(vertices, faces, corner.astype(np.float32), texcoords)


def extract_height_field(model: mujoco.MjModel, field: int) -> Mesh:
    """A height field as a closed mesh: surface, four sides and bottom, in its geom's frame.

    Each cell is cut from (column, row) to (column + 1, row + 1), as MuJoCo's rays and pictures do.
    EvsError: not finite.
    """
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    half_x, half_y, top, bottom = (float(length) for length in model.hfield_size[field])
    first = model.hfield_adr[field]
    height = np.asarray(model.hfield_data[first : first + rows * columns], np.float64) * top
    _check_finite(height, "height field", name_of(model, mujoco.mjtObj.mjOBJ_HFIELD, field))
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    surface = np.stack([x.ravel(), y.ravel(), height], axis=1)

    # two triangles a cell, counter-clockwise from above
    grid = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b = grid[:-1, :-1].ravel(), grid[:-1, 1:].ravel()
    c, d = grid[1:, 1:].ravel(), grid[1:, :-1].ravel()
    top_faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])

    # the rim once around, counter-clockwise from above, and its copy at the bottom
    rim = np.concatenate([grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]])
    lower = np.arange(len(rim), dtype=np.int32) + rows * columns
    skirt = surface[rim] * (1.0, 1.0, 0.0) - (0.0, 0.0, bottom)
    next_rim, next_lower = np.roll(rim, -1), np.roll(lower, -1)
    sides = np.concatenate(
        [np.stack([lower, next_lower, next_rim], 1), np.stack([lower, next_rim, rim], 1)]
    )

    # the bottom as a fan around its centre, so that no edge has a corner in its middle
    centre = np.full_like(lower, len(surface) + len(skirt))
    fan = np.stack([centre, next_lower, lower], 1)
    vertices = np.concatenate([surface, skirt, [[0.0, 0.0, -bottom]]])
    faces = np.concatenate([top_faces, sides, fan])
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32))


def _check_finite(values: F32 | F64, what: str, name: str) -> None:
    """MuJoCo's parser refuses such values; a model may get them later."""
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        values_are = "1 value that is" if bad == 1 else f"{bad} values that are"
        raise EvsError(f"{what} '{name}' has {values_are} not finite; use finite numbers")


def face_normals(vertices: F32, faces: I32) -> F64:
    """(nf, 3) unit normals; (0, 0, 1) where a face has no area."""
    a, b, c = (np.asarray(vertices, np.float64)[faces[:, corner]] for corner in range(3))
    return _unit(np.cross(b - a, c - a), np.array([0.0, 0.0, 1.0]))


def _unit(vectors: F64, instead: F64) -> F64:
    """`vectors` at length one; `instead` where the length is zero or not finite."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    good = np.isfinite(length) & (length > 0.0)
    return np.where(good, vectors / np.where(good, length, 1.0), instead)
