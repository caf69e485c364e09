"""Checkers, grids and single colours are integrated over what each pixel covers of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.features import Switches
from evs.emulator.base.scene import (
    F32,
    CameraModel,
    CameraPose,
    SceneModel,
    Shape,
    Surface,
    Texture,
    TextureKind,
)
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from reference.scenes import scene_of, shot_of

SIZE, TEXELS = 48, 512
POINTS = Switches(off=frozenset({"texture_filter"}))
PLANE = (0.0, 0.0, 0.1)
SIZES = {
    Shape.PLANE: (1.5, 1.0, 0.1),
    Shape.SPHERE: (0.6, 0.0, 0.0),
    Shape.CAPSULE: (0.4, 0.5, 0.0),
    Shape.CYLINDER: (0.6, 0.5, 0.0),
    Shape.BOX: (0.7, 0.5, 0.6),
}


def image_of(columns: list[int], rows: list[int], stray: bool = False) -> Texture:
    """Constant between these texels; `stray` ones in a corner keep it from being recognised."""
    at = np.arange(TEXELS)
    tile = np.searchsorted(rows, at, "right")[:, None] + np.searchsorted(columns, at, "right")
    image = np.array([30, 220, 90, 160, 60], np.uint8)[tile % 5 if len(rows) > 1 else tile % 2]
    if stray:
        image[0, 0:16:2] ^= 1
    return Texture(TextureKind.FLAT, image[..., None], False)


def scene(shape: Shape, size: tuple[float, ...], texture: Texture, repeat: float) -> SceneModel:
    surface = Surface((1, 1, 1, 1), 0, (repeat, repeat), False, emission=1.0, specular=0.0)
    return scene_of([shape], size, static=True, lights=(), surfaces=(surface,), textures=(texture,))


def pose(turn: float, drop: float, roll: float, away: float) -> CameraPose:
    """From `away` metres at a slant of `drop` below the horizon, degrees."""
    turn, drop, roll = np.deg2rad([turn, drop, roll])
    back = np.array([np.cos(turn) * np.cos(drop), np.sin(turn) * np.cos(drop), np.sin(drop)])
    side = np.array([-np.sin(turn), np.cos(turn), 0.0])
    right = np.cos(roll) * side + np.sin(roll) * np.cross(back, side)
    axes = np.stack([right, np.cross(back, right), back], 1)
    return CameraPose(away * back, np.ascontiguousarray(axes.reshape(9)))


def camera_of(focal: float, orthographic: bool = False) -> CameraModel:
    return CameraModel(
        SIZE, SIZE, focal, 1.25 * focal, SIZE / 2, SIZE / 2, orthographic=orthographic
    )


def light_of(
    world: SceneModel, camera: CameraModel, view: CameraPose, spp: int, antialiasing: str = "fixed"
) -> F32:
    renderer = make_renderer(world, camera, RenderConfig(spp=spp, antialiasing=antialiasing), 1)
    return renderer.render(shot_of(world, np.zeros(3)), view).copy()


@pytest.mark.parametrize("spp", [1, 4, 16])
@pytest.mark.parametrize("orthographic", [False, True], ids=["perspective", "orthographic"])
def test_an_edge_that_creeps_is_a_ramp(orthographic: bool, spp: int) -> None:
    # looking straight down on squares of 0.25 m that lie along the pixels
    world = scene(Shape.PLANE, PLANE, image_of([TEXELS // 2], [TEXELS // 2]), 4.0)
    focal = 60.0
    camera = camera_of(focal, orthographic)
    down = np.eye(3).reshape(9)
    pixel = np.array([1 / focal, 1 / (1.25 * focal)]) * (1.0 if orthographic else 1.5)
    dark, bright = 30 / 255, 220 / 255

    def wave(at: np.ndarray) -> np.ndarray:
        """Integral of a wave that is +-1 in squares of 0.25 m."""
        share = np.mod(at / 0.5, 1.0)
        return np.minimum(share, 1 - share) * 0.5

    for x in np.linspace(0.01, 0.03, 6):
        # 0.13: no pixel of the picture sees an edge lie along its own rim
        position = np.array([0.013 + x, 0.1307, 1.5])
        light = light_of(world, camera, CameraPose(position, down), spp)
        edges = (np.arange(SIZE + 1) - SIZE / 2)[:, None] * pixel * [1, -1] + position[:2]
        u = np.diff(wave(edges[:, 0])) / np.diff(edges[:, 0])
        v = np.diff(wave(edges[:, 1])) / np.diff(edges[:, 1])
        product = v[:, None] * u
        exact = (bright + dark) / 2 + (bright - dark) / 2 * product
        error = min(np.abs(light - exact).max(), np.abs(light - (bright + dark - exact)).max())
        assert error < 2e-4


@pytest.mark.parametrize("orthographic", [False, True], ids=["perspective", "orthographic"])
# without rims, where two sides of a shape meet in a pixel
@pytest.mark.slow
@pytest.mark.parametrize("shape", [Shape.PLANE, Shape.SPHERE, Shape.CAPSULE])
def test_one_sample_is_nearer_to_the_area_than_a_filter_of_texels(
    shape: Shape, orthographic: bool
) -> None:
    # a line of two texels, as MuJoCo's marks are, and tiles of several widths
    columns, rows = [2, 200, 380], [100, 256, 258]
    tiled, texels = (
        scene(shape, SIZES[shape], image_of(columns, rows, stray), 2.0) for stray in (False, True)
    )
    camera = camera_of(24.0 if orthographic else 60.0, orthographic)
    square = np.zeros(3)
    for turn, drop, roll in ((20, 35, 0), (75, 20, 30), (200, 55, 45)):
        view = pose(turn, drop, roll, 3.0)
        shot = shot_of(tiled, np.zeros(3))
        hit = NativeRenderer(tiled, camera, RenderConfig(spp=1), 1).hits(shot, view)[0] >= 0
        inside = hit[1:-1, 1:-1] & hit[:-2, 1:-1] & hit[2:, 1:-1] & hit[1:-1, :-2] & hit[1:-1, 2:]
        config = RenderConfig(renderer="path", spp=1024, seeds="fixed")
        truth = make_renderer(texels, camera, config, 1, switches=POINTS).render(shot, view)
        for k, (world, spp) in enumerate(((texels, 1), (tiled, 1), (tiled, 16))):
            light = light_of(world, camera, view, spp)
            square[k] += (((light - truth)[1:-1, 1:-1][inside]) ** 2).sum()
    assert square[1] < 0.4 * square[0]
    assert square[2] < 0.2 * square[1]


@pytest.mark.parametrize(
    ("columns", "rows"),
    [([], []), ([200], []), ([2, 200, 380], [100, 256, 258]), ([2, 200, 300, 500], [256])],
    ids=["one colour", "stripes", "grid", "five columns"],
)
@pytest.mark.parametrize("bent", [False, True], ids=["pinhole", "lens"])
def test_tiles_are_the_same_bytes_everywhere(
    columns: list[int], rows: list[int], bent: bool
) -> None:
    shapes = list(SIZES)
    surface = Surface((1, 1, 1, 1), 0, (1.5, 2.0), True, emission=1.0, specular=0.0)
    world = scene_of(
        shapes, [SIZES[shape] for shape in shapes], static=True, lights=(), surfaces=(surface,),
        textures=(image_of(columns, rows),),
    )  # fmt: skip
    around = np.linspace(0, 2 * np.pi, len(shapes), endpoint=False)
    shot = shot_of(world, np.stack([1.3 * np.cos(around), 1.3 * np.sin(around), 0 * around], 1))
    view, camera = pose(30, 35, 20, 3.0), camera_of(40.0)
    if bent:
        camera = replace(camera, distortion_model="plumb_bob", distortion=(-0.1, 0, 0, 0, 0))
    for spp in (1, 4):
        light = [
            NativeRenderer(
                world, camera, RenderConfig(spp=spp, antialiasing="fixed", isa=isa), threads
            )
            .render(shot, view)
            .copy()
            for isa in _core.isa_available()
            for threads in (1, 2)
        ]
        assert np.isfinite(light[0]).all()
        for other in light[1:]:
            np.testing.assert_array_equal(other, light[0])


def test_a_small_image_is_blended_as_viewers_do() -> None:
    small = Texture(TextureKind.FLAT, np.array([[[30], [220]]], np.uint8).repeat(2, 0), False)
    view, camera = CameraPose(np.array([0.1, 0.1, 0.3]), np.eye(3).reshape(9)), camera_of(60.0)
    light = light_of(scene(Shape.PLANE, PLANE, small, 1.0), camera, view, 1)
    sharp = light_of(scene(Shape.PLANE, PLANE, image_of([TEXELS // 2], []), 1.0), camera, view, 1)
    # no pixel wholly in one colour beside one wholly in another
    assert np.abs(np.diff(light, axis=1)).max() < 0.1
    assert np.abs(np.diff(sharp, axis=1)).max() > 0.3


@pytest.mark.parametrize("orthographic", [False, True], ids=["perspective", "orthographic"])
def test_a_pixel_that_is_not_refined_is_integrated_as_a_whole(orthographic: bool) -> None:
    # a floor without end, above whose horizon nothing is seen
    world = scene(Shape.PLANE, PLANE, image_of([TEXELS // 2], [TEXELS // 2]), 4.0)
    camera, view = camera_of(60.0, orthographic), pose(25, 60, 10, 2.0)
    one = light_of(world, camera, view, 1)
    assert one.min() > 0
    assert one.std() > 0.1
    for spp in (4, 16):
        assert np.allclose(light_of(world, camera, view, spp, "adaptive"), one, atol=1e-5)


@pytest.mark.parametrize("turn", [0, 90])
def test_far_tiles_are_averaged_though_they_run_askew(turn: float) -> None:
    # to the left and right, lines that lead away run across several rows of far pixels
    world = scene(Shape.PLANE, PLANE, image_of([TEXELS // 2], [TEXELS // 2]), 4.0)
    camera, view, below = camera_of(30.0), pose(turn, 14, 0, 8.0), slice(SIZE // 2, None)
    config = RenderConfig(renderer="path", spp=1024, seeds="fixed")
    points = make_renderer(world, camera, config, 1, switches=POINTS)
    truth = points.render(shot_of(world, np.zeros(3)), view)
    error = {
        spp: np.abs(light_of(world, camera, view, spp) - truth)[below].mean() for spp in (1, 16)
    }
    assert error[1] < 0.75 * error[16]
