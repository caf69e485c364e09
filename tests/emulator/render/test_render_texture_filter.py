"""Images are read along what a pixel covers of them: one sample comes near the mean of many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import (
    F32,
    CameraModel,
    CameraPose,
    Mesh,
    SceneModel,
    SceneSnapshot,
    Shape,
    Surface,
    Texture,
    TextureKind,
)
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from reference.scenes import scene_of, shot_of

SIZE = 64
OFF = Switches(off=frozenset({"texture_filter"}))
SIZES = {
    Shape.PLANE: (1.5, 1.0, 0.1),
    Shape.SPHERE: (0.6, 0.0, 0.0),
    Shape.CAPSULE: (0.4, 0.5, 0.0),
    Shape.ELLIPSOID: (0.8, 0.5, 0.6),
    Shape.CYLINDER: (0.6, 0.5, 0.0),
    Shape.BOX: (0.7, 0.5, 0.6),
    Shape.MESH: (1.0, 1.0, 1.0),
}


def sheet(coordinates: bool) -> Mesh:
    """A strip of folded paper; its coordinates are skewed against it."""
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 9), np.linspace(-0.8, 0.8, 3), indexing="ij")
    vertices = np.stack([x, y, 0.15 * (np.arange(9) % 2)[:, None] + 0 * x], -1).reshape(-1, 3)
    at = 3 * np.arange(8)[:, None] + np.arange(2)
    quads = np.stack([at, at + 3, at + 4, at + 1], -1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    uv = vertices[:, :2] @ np.array([[0.5, 0.2], [-0.1, 0.7]]) if coordinates else None
    return Mesh(
        vertices.astype(np.float32),
        faces,
        None,
        None if uv is None else uv[faces].astype(np.float32),
    )


def noise_of(kind: TextureKind, rng: np.random.Generator) -> Texture:
    """Fine grain, which has power in every direction and at every scale."""
    shape = (64, 48, 1) if kind is TextureKind.FLAT else (6, 16, 16, 1)
    return Texture(kind, rng.choice(np.array([20, 230], np.uint8), shape), False)


def look(
    rng: np.random.Generator, focal: float, orthographic: bool
) -> tuple[CameraModel, CameraPose]:
    """From above at a slant, rolled anyhow, on pixels that are not square."""
    turn, drop = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(12, 40))
    back = np.array([np.cos(turn) * np.cos(drop), np.sin(turn) * np.cos(drop), np.sin(drop)])
    x = np.cross(rng.normal(size=3), back)
    x /= np.linalg.norm(x)
    axes = np.stack([x, np.cross(back, x), back], 1)
    camera = CameraModel(
        SIZE, SIZE, focal, 1.25 * focal, SIZE / 2, SIZE / 2, orthographic=orthographic
    )
    return camera, CameraPose(3 * back, np.ascontiguousarray(axes.reshape(9)))


def errors(
    scene: SceneModel, shot: SceneSnapshot, camera: CameraModel, pose: CameraPose, spp: int = 1
) -> np.ndarray:
    """Sum of the squared errors of light with the filter and without, where nothing ends."""

    def light(samples: int, switches: Switches) -> F32:
        config = RenderConfig(spp=samples, antialiasing="fixed")
        return make_renderer(scene, camera, config, 1, switches=switches).render(shot, pose).copy()

    renderer = make_renderer(scene, camera, RenderConfig(spp=1), 1)
    there = renderer.hits(shot, pose)[0] >= 0  # type: ignore[attr-defined]
    inside = there[1:-1, 1:-1].copy()
    for i in range(9):
        inside &= there[i // 3 : SIZE - 2 + i // 3, i % 3 : SIZE - 2 + i % 3]
    truth = light(64, OFF)
    return np.array(
        [
            float(((light(spp, switches) - truth)[1:-1, 1:-1][inside] ** 2).sum())
            for switches in (UNFORCED, OFF)
        ]
    )


@pytest.mark.parametrize("orthographic", [False, True], ids=["perspective", "orthographic"])
@pytest.mark.parametrize("kind", [TextureKind.FLAT, TextureKind.CUBE])
@pytest.mark.parametrize("shape", [*SIZES, "mesh with coordinates"])
def test_one_sample_is_nearer_to_the_mean_of_many(
    shape: Shape | str, kind: TextureKind, orthographic: bool
) -> None:
    rng = np.random.default_rng(3)
    own = isinstance(shape, str)
    kind_of = Shape.MESH if isinstance(shape, str) else shape
    scene = scene_of(
        [kind_of],
        SIZES[kind_of],
        static=True,
        lights=(),
        meshes=(sheet(own),) if kind_of is Shape.MESH else (),
        surfaces=(Surface((1, 1, 1, 1), 0, (1.5, 2.0), True, emission=1.0, specular=0.0),),
        textures=(noise_of(kind, rng),),
    )
    total = np.zeros(2)
    for _ in range(6):
        camera, pose = look(rng, 24.0 if orthographic else 72.0, orthographic)
        total += errors(scene, shot_of(scene, np.zeros(3)), camera, pose)
    # the flat image is seen at more of a slant; with the filter off the ratio is 1
    assert total[0] < (0.5 if kind is TextureKind.FLAT else 0.85) * total[1]


@pytest.mark.parametrize("bent", [False, True], ids=["pinhole", "lens"])
@pytest.mark.parametrize("kind", [TextureKind.FLAT, TextureKind.CUBE])
def test_every_shape_is_the_same_bytes_everywhere(kind: TextureKind, bent: bool) -> None:
    rng = np.random.default_rng(5)
    shapes = [*SIZES, Shape.MESH]
    scene = scene_of(
        shapes,
        [SIZES[shape] for shape in shapes],
        mesh=[0] * (len(shapes) - 1) + [1],
        static=True,
        lights=(),
        meshes=(sheet(False), sheet(True)),
        surfaces=(Surface((1, 1, 1, 1), 0, (1.5, 2.0), True, emission=1.0, specular=0.0),),
        textures=(noise_of(kind, rng),),
    )
    around = np.linspace(0, 2 * np.pi, len(shapes), endpoint=False)
    places = np.stack([1.3 * np.cos(around), 1.3 * np.sin(around), 0 * around], 1)
    camera, pose = look(rng, 40.0, False)
    if bent:
        camera = replace(camera, distortion_model="plumb_bob", distortion=(-0.1, 0, 0, 0, 0))
    shot = shot_of(scene, places)
    pixels = rng.integers(0, SIZE, (50, 2)).astype(np.int32)
    light = {}
    for isa in _core.isa_available():
        renderer = NativeRenderer(scene, camera, RenderConfig(spp=1, isa=isa), 1)
        light[isa] = renderer.render(shot, pose).copy()
        assert len(np.unique(light[isa])) > 500
        picked = renderer.trace(shot, pose, pixels)
        np.testing.assert_array_equal(picked, light[isa][pixels[:, 1], pixels[:, 0]])
    for other in light.values():
        np.testing.assert_array_equal(other, next(iter(light.values())))
