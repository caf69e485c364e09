"""The numerical contract of the light: whatever the scene, finite, not negative, never a NaN."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import LightKind, Mesh, Shape, Surface
from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from reference.stage import Builder, Stage, matt, turned
from reference.tessellation import ball

pytestmark = pytest.mark.extremes

RENDERERS = {
    "direct": RenderConfig(spp=2),
    "hybrid": RenderConfig(renderer="hybrid", spp=2, bounces=3),
    "path": RenderConfig(renderer="path", spp=2, bounces=3),
}
SHAPES = [shape for shape in Shape if shape is not Shape.HFIELD]
SHINY = Surface((0.9, 0.9, 0.9, 1.0), specular=1.0, shininess=1.0, reflectance=0.3)


def light_of(stage: Stage, config: RenderConfig) -> np.ndarray:
    """What every instruction set agrees on, finite and not negative."""
    pictures = [
        np.array(
            make_renderer(stage.scene, stage.camera, replace(config, isa=isa), 1).render(
                stage.shot, stage.pose
            )
        )
        for isa in _core.isa_available()
    ]
    for picture in pictures:
        np.testing.assert_array_equal(picture.view(np.int32), pictures[0].view(np.int32))
    assert np.isfinite(pictures[0]).all()
    assert (pictures[0] >= 0).all()
    return pictures[0]


@pytest.fixture(params=RENDERERS)
def config(request: pytest.FixtureRequest) -> RenderConfig:
    return RENDERERS[request.param]


def lamps(made: Builder, reach: float = 1.0, strength: float = 1.0) -> None:
    """One of each kind; `reach` m away."""
    colour = (strength, strength, strength)
    made.shine(LightKind.DIRECTIONAL, towards=(0.2, 0.1, -1), diffuse=colour, specular=colour)
    colour = (strength * reach**2,) * 3
    for kind, x in ((LightKind.POINT, 0.5), (LightKind.SPOT, -0.5)):
        place = (x * reach, 0.3 * reach, 2 * reach)
        made.shine(kind, place, (-x, -0.3, -2), diffuse=colour, specular=colour,
                   bulbradius_m=0.05 * reach)  # fmt: skip


@pytest.mark.parametrize("metres", [1e-6, 1e-3, 1.0, 1e3, 1e5])
def test_a_scene_of_any_size_is_the_same_picture(metres: float, config: RenderConfig) -> None:
    def of(scale: float) -> Stage:
        made = Builder()
        made.add(Shape.PLANE, (3 * scale, 3 * scale, 1), (0, 0, 0), matt(0.6))
        made.add(Shape.SPHERE, (0.4 * scale,), (-0.5 * scale, 0, 0.4 * scale), SHINY)
        size = (0.3 * scale, 0.2 * scale, 0.25 * scale)
        made.add(Shape.BOX, size, (0.5 * scale, 0, 0.3 * scale), matt(0.3))
        mesh = ball(6, np.full(3, 0.3 * scale))
        made.add(Shape.MESH, (1, 1, 1), (0, 0.6 * scale, 0.4 * scale), matt(0.8), mesh=mesh)
        lamps(made, scale)
        return made.look((0.3 * scale, -3 * scale, 1.8 * scale), (0, 0, 0.2 * scale))

    light, usual = light_of(of(metres), config), light_of(of(1.0), config)
    # but for pixels whose samples fall on the other side of an edge, and for cached light, whose
    # lattice has another place
    near = 0.02 if config.renderer == "hybrid" else 1e-3
    apart = np.abs(light - usual) > near * usual.max()
    assert apart.mean() < 0.02
    assert usual.max() > 0


@pytest.mark.parametrize("degrees", [90.0, 89.9999, 90.0001, 80.0, 0.0])
def test_rays_along_a_plane_and_in_it(degrees: float, config: RenderConfig) -> None:
    # the eye in the plane's own plane, a hair above it, and a hair below
    for height in (0.0, 1e-30, 1e-9, -1e-9, 1e-4):
        made = Builder()
        made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), SHINY)
        made.add(Shape.PLANE, (1, 1, 1), (0, 2, 0), matt(0.5), turn=turned((1, 0, 0), degrees))
        made.add(Shape.BOX, (0.5, 0.5, 0.5), (0, 1, height), SHINY)
        lamps(made)
        # and a lamp in the plane
        made.shine(LightKind.POINT, (0.7, 0.7, 0.0), diffuse=(1, 1, 1))
        made.shine(LightKind.DIRECTIONAL, towards=(0, 1, 0), diffuse=(1, 1, 1))
        light_of(made.look((0, -1, height), (0, 1, height), size=(17, 13)), config)
        parallel = made.look((0, -1, height), (0, 1, height), size=(16, 16), fovy_deg=2.0,
                             orthographic=True)  # fmt: skip
        light_of(parallel, config)


@pytest.mark.parametrize("size", [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.3),
                                  (1e-30, 1e-30, 1e-30), (1e-20, 1.0, 1.0)])  # fmt: skip
@pytest.mark.parametrize("shape", SHAPES)
def test_geoms_without_a_size(
    shape: Shape, size: tuple[float, float, float], config: RenderConfig
) -> None:
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(0.5))
    flat = Mesh(*(np.array(a, b) for a, b in (((np.outer([0, 1, 0, 1], size)), np.float32),
                                             (((0, 1, 2), (1, 3, 2)), np.int32))))  # fmt: skip
    for surface, x in ((matt(0.5), 0.0), (SHINY, 0.1), (matt(0.5, emission=2.0), -0.1)):
        mesh = flat if shape is Shape.MESH else None
        made.add(shape, size, (x, 0, 0.3), surface, turn=turned((1, 1, 0), 40), mesh=mesh)
    lamps(made)
    # a lamp inside it
    made.shine(LightKind.POINT, (0, 0, 0.3), diffuse=(0.1, 0.1, 0.1))
    assert light_of(made.look((0, -2, 1), (0, 0, 0.3), size=(21, 18)), config).max() > 0


def test_triangles_without_a_face(config: RenderConfig) -> None:
    # points, lines, and slivers that only rounding sets apart, with normals of no length
    rng = np.random.default_rng(0)
    corner = rng.normal(size=(40, 1, 3)) * 0.3
    along, across = rng.normal(size=(2, 40, 1, 3))
    t = np.array([0.0, 0.4, 1.0])[None, :, None]
    width = np.repeat([0.0, 1e-12, 1e-7, 1e-4], 10)[:, None, None] * np.array([0, 1, 0])[:, None]
    corners = corner + t * along * np.repeat([0, 1], 20)[:, None, None] + width * across
    faces = np.arange(120).reshape(40, 3).astype(np.int32)
    for normals in (None, np.zeros((40, 3, 3), np.float32)):
        made = Builder()
        made.add(Shape.PLANE, (0, 0, 1), (0, 0, -1), matt(0.5))
        for surface in (SHINY, matt(0.5, emission=3.0)):
            mesh = Mesh(corners.reshape(-1, 3).astype(np.float32), faces, normals)
            made.add(Shape.MESH, (1, 1, 1), (0, 0, 0), surface, mesh=mesh)
        lamps(made)
        light_of(made.look((0, -2, 1), (0, 0, 0), size=(40, 30)), config)


@pytest.mark.parametrize("strength", [1e9, 1e-30, 0.0])
def test_light_a_billion_times_too_strong(strength: float, config: RenderConfig) -> None:
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), SHINY)
    made.add(Shape.SPHERE, (0.3,), (0, 0, 0.3), matt(1.0, emission=strength))
    lamps(made, strength=strength)
    # a lamp on the floor: its 1 / r^2 has no bound
    made.shine(LightKind.POINT, (0.5, -0.5, 0.0), diffuse=(strength,) * 3, bulbradius_m=0.0)
    made.shine(LightKind.POINT, (0.5, -0.5, 1e-6), intensity=strength * 1e3, diffuse=(1, 1, 1))
    light = light_of(made.look((0, -2, 1), (0, 0, 0.3)), config)
    assert light.max() >= 0.1 * strength
