"""A mesh's tree against no tree: each triangle a geom of its own must give the same light."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import LightKind, Mesh, Shape
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from reference.stage import Builder, Stage, matt
from reference.tessellation import ball, soup, waves

pytestmark = pytest.mark.property

CONFIGS = {
    "direct": RenderConfig(spp=4),
    "path": RenderConfig(renderer="path", spp=4, bounces=2),
}


MESHES = {
    "ball": ball(6, (0.9, 0.7, 0.8)),
    "flat ball": ball(5, (0.9, 0.9, 0.05), smooth=False),
    "waves": waves(1.2, 0.3, 12),
    "soup": soup(0),
    "another soup": soup(1),
}


def stage_of(mesh: Mesh, apart: bool) -> Stage:
    """The mesh over a floor, as one geom or as one for each triangle."""
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, -1.2), matt(0.5))
    if apart:
        for index, face in enumerate(mesh.faces):
            normals = None if mesh.normals is None else mesh.normals[index : index + 1]
            one = Mesh(mesh.vertices[face], np.array([[0, 1, 2]], np.int32), normals)
            made.add(Shape.MESH, (1, 1, 1), (0, 0, 0), matt(0.7), mesh=one)
    else:
        made.add(Shape.MESH, (1, 1, 1), (0, 0, 0), matt(0.7), mesh=mesh)
    made.shine(LightKind.POINT, (1.5, -2.0, 3.0), diffuse=(9, 9, 9), bulbradius_m=0.2)
    made.shine(LightKind.DIRECTIONAL, towards=(-1, 1, -1), diffuse=(0.5, 0.5, 0.5))
    return made.look((0.5, -3.5, 1.5), (0, 0, -0.2), size=(64, 48), path=True)


@pytest.mark.parametrize("name", MESHES)
def test_a_tree_hits_what_its_triangles_hit(name: str) -> None:
    whole, apart = (stage_of(MESHES[name], apart) for apart in (False, True))
    seen = [
        NativeRenderer(stage.scene, stage.camera, RenderConfig(spp=1), 1).hits(
            stage.shot, stage.pose
        )
        for stage in (whole, apart)
    ]
    np.testing.assert_array_equal(seen[0][0], np.minimum(seen[1][0], 1))
    np.testing.assert_allclose(seen[0][1], seen[1][1], rtol=1e-5)
    # most of the triangles that face the eye were met
    assert len(np.unique(seen[1][0])) > len(MESHES[name].faces) / 8


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("name", MESHES)
def test_a_tree_gives_the_light_of_its_triangles(name: str, config: str) -> None:
    pictures = []
    for apart in (False, True):
        stage = stage_of(MESHES[name], apart)
        renderer = make_renderer(stage.scene, stage.camera, CONFIGS[config], 2)
        pictures.append(np.array(renderer.render(stage.shot, stage.pose), np.float64))
    # where rays leave a surface depends a little on the geom's size: an edge of a shadow may tell
    apart_by = np.abs(pictures[0] - pictures[1])
    assert (apart_by > 1e-4).mean() < 0.01
    assert apart_by.mean() < 1e-3 * pictures[0].mean()
