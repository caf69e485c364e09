"""Shapes as triangles and images in smaller versions, as the raster renderer draws them."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import Shape, Surface
from evs.emulator.render.raster.drawing import linear_texels, smaller_versions
from evs.emulator.render.raster.tessellate import TriangleMesh, sky_box, tessellate
from reference.closed_forms import linear


def volume(triangles: TriangleMesh) -> float:
    """Of the closed surface, by the divergence theorem; negative if it is inside out."""
    a, b, c = (triangles.positions[triangles.faces[:, k]].astype(np.float64) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


SOLIDS = {
    Shape.SPHERE: ((0.5, 0, 0), 4 / 3 * np.pi * 0.5**3),
    Shape.CAPSULE: ((0.3, 0.7, 0), np.pi * 0.3**2 * (1.4 + 4 / 3 * 0.3)),
    Shape.ELLIPSOID: ((0.3, 0.5, 0.2), 4 / 3 * np.pi * 0.3 * 0.5 * 0.2),
    Shape.CYLINDER: ((0.4, 0.6, 0), np.pi * 0.4**2 * 1.2),
    Shape.BOX: ((0.3, 0.5, 0.2), 8 * 0.3 * 0.5 * 0.2),
}


def solid(shape: Shape, cube: bool = False) -> TriangleMesh:
    return tessellate(shape, np.array(SOLIDS[shape][0], np.float32), None, Surface(), cube, 1.0)


@pytest.mark.parametrize("shape", SOLIDS)
def test_a_shape_is_closed_and_faces_outwards(shape: Shape) -> None:
    triangles = solid(shape)
    # 48 segments a circle lose 0.3 % of its area, and a ball as much again along its meridian
    assert SOLIDS[shape][1] * 0.99 < volume(triangles) < SOLIDS[shape][1] * (1 + 1e-6)
    np.testing.assert_allclose(np.linalg.norm(triangles.normals, axis=1), 1, rtol=1e-5)
    corner = triangles.positions[triangles.faces].astype(np.float64)
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    real = np.linalg.norm(across, axis=1) > 1e-9
    smooth = triangles.normals[triangles.faces].mean(axis=1)
    assert (np.einsum("ij,ij->i", across, smooth)[real] > 0).all()


def test_a_room_is_seen_from_inside() -> None:
    assert volume(sky_box(2.0)) == pytest.approx(-64)


def test_a_plane_is_as_large_as_it_says_and_an_endless_one_reaches_far() -> None:
    finite = tessellate(Shape.PLANE, np.float32([2, 3, 0.1]), None, Surface(), False, 1.0)
    np.testing.assert_allclose(np.abs(finite.positions).max(axis=0), [2, 3, 0])
    endless = tessellate(Shape.PLANE, np.float32([0, 3, 0.1]), None, Surface(), False, 2.0)
    np.testing.assert_allclose(np.abs(endless.positions).max(axis=0), [2000, 3, 0])
    # an infinite side: one image every 2 m / texrepeat
    x, u = endless.positions[:, 0], endless.coordinates[:, 0]
    np.testing.assert_allclose(u, x / 2 - 0.5, rtol=1e-6)


@pytest.mark.parametrize("shape", SOLIDS)
def test_the_direction_into_a_cube_is_the_point_on_the_unit_shape(shape: Shape) -> None:
    size = np.array(SOLIDS[shape][0], np.float32)
    half = {Shape.SPHERE: size[[0, 0, 0]], Shape.CYLINDER: size[[0, 0, 1]]}.get(shape, size)
    triangles = solid(shape, cube=True)
    if shape is Shape.CAPSULE:
        # the caps go on from 1 to 2
        assert triangles.coordinates[:, 2].max() == pytest.approx(2)
        assert triangles.coordinates[:, 2].min() == pytest.approx(-2)
        across = triangles.positions[:, :2] / size[0]
        np.testing.assert_allclose(triangles.coordinates[:, :2], across, atol=1e-6)
    else:
        np.testing.assert_allclose(triangles.coordinates, triangles.positions / half, atol=1e-6)


def test_smaller_versions_keep_the_mean_of_odd_sizes() -> None:
    image = np.random.default_rng(3).integers(0, 256, (75, 127, 3), dtype=np.uint8)
    levels = list(smaller_versions(linear_texels(image, srgb=True)))
    assert [level.shape[:2] for level in levels] == [
        *((75, 127), (37, 63), (18, 31), (9, 15), (4, 7), (2, 3), (1, 1)),
    ]
    decoded = linear(image / 255.0)
    np.testing.assert_allclose(levels[0], decoded, rtol=1e-6)
    np.testing.assert_allclose(levels[-1][0, 0], decoded.mean(axis=(0, 1)), rtol=1e-6)
