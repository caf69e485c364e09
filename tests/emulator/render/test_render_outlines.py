"""Outlines of shapes are blended by the area they cover, so light follows them without steps."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import F32, CameraModel, CameraPose, SceneModel, Shape, Surface
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from reference.scenes import SAMPLED_OUTLINES, scene_of, shot_of

SIZE, ZOOM = 24, 16
GLOW = (Surface((1, 1, 1, 1), -1, (1, 1), False, emission=1.0, specular=0.0),)
SIZES = {
    Shape.PLANE: (0.5, 0.4, 0.1),
    Shape.SPHERE: (0.5, 0.0, 0.0),
    Shape.CAPSULE: (0.25, 0.4, 0.0),
    Shape.ELLIPSOID: (0.3, 0.5, 0.2),
    Shape.CYLINDER: (0.3, 0.4, 0.0),
    Shape.BOX: (0.4, 0.3, 0.35),
}
ADAPTIVE = {"antialiasing": "adaptive"}


def turned(angles: tuple[float, float, float]) -> np.ndarray:
    """A rotation about x, y and z, degrees: row-major (9,)."""
    out = np.eye(3)
    for axis, angle in enumerate(np.deg2rad(angles)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[[i, i, j, j], [i, j, i, j]] = (
            np.cos(angle),
            -np.sin(angle),
            np.sin(angle),
            np.cos(angle),
        )
        out = turn @ out
    return out.reshape(9)


def glowing(*shapes: Shape, sizes: dict[Shape, tuple[float, ...]] = SIZES) -> SceneModel:
    return scene_of(shapes, [sizes[shape] for shape in shapes], lights=(), surfaces=GLOW)


def light_of(
    scene: SceneModel, places: object, mats: object = None, *, aside: float = 0.0, zoom: int = 1,
    switches: Switches = UNFORCED, **render: object,
) -> F32:  # fmt: skip
    """Seen from 3 m away, along -z."""
    size = SIZE * zoom
    camera = CameraModel(size, size, 40.0 * zoom, 44.0 * zoom, size / 2, size / 2)
    view = CameraPose(np.array([aside, 0.0, 3.0]), np.eye(3).reshape(9))
    config = RenderConfig(**{"antialiasing": "fixed", **render})  # type: ignore[arg-type]
    renderer = make_renderer(scene, camera, config, 1, switches=switches)
    return renderer.render(shot_of(scene, places, mats), view).copy()


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize(
    ("render", "bound"),
    [({"spp": 1}, 0.02), ({"spp": 4}, 0.006), ({"spp": 16}, 0.004), ({"spp": 4, **ADAPTIVE}, 0.02)],
    ids=["1", "4", "16", "adaptive"],
)
def test_an_outline_covers_its_area(shape: Shape, render: dict[str, object], bound: float) -> None:
    scene, squares, points = glowing(shape), [], []
    for angles in ((10, 20, 30), (70, 5, 45), (35, 60, 15)):
        mat = turned(angles)
        fine = light_of(scene, np.zeros(3), mat, zoom=ZOOM, spp=4, switches=SAMPLED_OUTLINES)
        area = fine.reshape(SIZE, ZOOM, SIZE, ZOOM).mean((1, 3))
        edge = (area > 0) & (area < 1)
        light = light_of(scene, np.zeros(3), mat, **render)
        squares.append((light - area)[edge] ** 2)
        sampled = light_of(scene, np.zeros(3), mat, **render, switches=SAMPLED_OUTLINES)
        points.append((sampled - area)[edge] ** 2)
        np.testing.assert_allclose(light[~edge], area[~edge], atol=0.003)
    error, by_points = (float(np.sqrt(np.concatenate(s).mean())) for s in (squares, points))
    assert error < bound
    assert error < 0.15 * by_points


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("renderer", ["direct", "hybrid"])
def test_light_follows_an_outline_without_steps(shape: Shape, renderer: str) -> None:
    scene, steps = glowing(shape), 40
    mat = turned((35, 20, 15))
    # a pixel is 3 / 40 m
    film = np.stack([
        light_of(scene, np.zeros(3), mat, aside=0.003 + 0.075 * k / steps, spp=1, renderer=renderer)
        for k in range(steps)
    ])  # fmt: skip
    assert np.ptp(film, axis=0).max() > 0.8
    # what is nearer to the camera than 3 m moves by more than a pixel, and a slanted edge covers a
    # pixel in fewer steps
    assert np.abs(np.diff(film, axis=0)).max() < 1.6 / steps


def test_nothing_shines_through_where_two_shapes_meet() -> None:
    boxes = {Shape.BOX: (0.3, 0.4, 0.3)}
    scene = glowing(Shape.BOX, Shape.BOX, sizes=boxes)
    for turn in (0.0, 20.0, 65.0):
        mat = turned((0, 0, turn))
        side = mat.reshape(3, 3)[:, 0] * 0.3
        for aside in (0.0, 0.011, 0.03):
            light = light_of(scene, [side, -side], np.stack([mat, mat]), aside=aside, spp=1)
            assert (
                light[SIZE // 2 - 3 : SIZE // 2 + 3, SIZE // 2 - 3 : SIZE // 2 + 3].min() > 0.9999
            )


def test_what_is_narrower_than_a_pixel_covers_a_part_of_it() -> None:
    # a quarter of a pixel wide
    rod = {Shape.CAPSULE: (0.009375, 5.0, 0.0)}
    mat = turned((90, 0, 0))
    for aside in np.linspace(0.0, 0.07, 8):
        light = light_of(
            glowing(Shape.CAPSULE, sizes=rod), np.zeros(3), mat, aside=float(aside), spp=1
        )
        np.testing.assert_allclose(light.sum(1), 0.25, rtol=2e-3)


@pytest.mark.parametrize("renderer", ["direct", "hybrid"])
@pytest.mark.parametrize("adaptive", [False, True], ids=["fixed", "adaptive"])
def test_outlines_are_the_same_bytes_everywhere(renderer: str, adaptive: bool) -> None:
    shapes = [*SIZES, *SIZES]
    around = np.arange(len(shapes)) * 2.4
    places = np.stack([0.1 * around * np.cos(around), 0.1 * around * np.sin(around), -0.2 * around])
    mats = np.stack([turned((40 * k, 25 * k, 70 * k)) for k in range(len(shapes))])
    surfaces = (Surface((0.8, 0.8, 0.8, 1), -1, (1, 1), False, emission=0.2),)
    scene = scene_of(shapes, [SIZES[shape] for shape in shapes], surfaces=surfaces)
    shot = shot_of(scene, places.T, mats)
    camera = CameraModel(67, 45, 60.0, 66.0, 33.0, 21.0)
    view = CameraPose(np.array([0.2, -0.1, 2.0]), np.eye(3).reshape(9))
    for spp in (1, 4):
        how = {"renderer": renderer, "spp": spp, **(ADAPTIVE if adaptive else {})}
        lights = [
            NativeRenderer(scene, camera, RenderConfig(isa=isa, **how), threads)
            .render(shot, view)
            .copy()
            for isa in _core.isa_available()
            for threads in (1, 2)
        ]
        assert np.isfinite(lights[0]).all()
        assert lights[0].min() >= 0
        assert np.ptp(lights[0]) > 0.1
        for light in lights[1:]:
            np.testing.assert_array_equal(light, lights[0])
