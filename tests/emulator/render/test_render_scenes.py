"""Random scenes: whatever is in them, the light is the same however it was computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer
from reference.random_scenes import RandomStage, check_film
from reference.scenes import SAMPLED_OUTLINES

pytestmark = pytest.mark.property


# a mirror that an orthographic camera sees was once forgotten in one scene of a hundred
@pytest.mark.parametrize(
    "first", [160, 330, *(pytest.param(k, marks=pytest.mark.slow) for k in (1050, 1600, 1770))]
)
def test_the_light_is_the_same_however_it_was_computed(first: int) -> None:
    check_film(range(first, first + 20), 12)


@pytest.mark.slow
@pytest.mark.parametrize("decades", [1.0, 6.0])
def test_the_light_of_physical_materials_in_fog_is_the_same(decades: float) -> None:
    check_film(range(40), 8, decades=decades, rich=True)


@pytest.mark.slow
@pytest.mark.parametrize("zoom", [0.01, 300.0])
def test_the_light_is_the_same_from_near_and_far(zoom: float) -> None:
    check_film(range(30), 8, zoom=zoom)


def test_the_light_is_the_same_over_eight_decades_of_size() -> None:
    check_film(range(40), 8, decades=6.0)


@pytest.mark.slow
@pytest.mark.campaign
@pytest.mark.parametrize(("decades", "zoom"), [(1.0, 1.0), (1.0, 1000.0), (6.0, 1.0), (3.0, 0.03)])
def test_the_light_is_the_same_in_many_scenes(decades: float, zoom: float) -> None:
    check_film(range(5000, 5600), 12, decades=decades, zoom=zoom)


def check_shifts(seeds: range, zoom: float, rich: bool = False) -> None:
    """Packets that begin elsewhere hold the same rays, so nothing that culls packets shows."""
    for seed in seeds:
        scene = RandomStage(seed, zoom=zoom, flat=False, rich=rich)
        spp = (1, 2, 4)[seed % 3]
        light = scene.shifted(0, 0, spp=spp)
        for dx, dy in ((1, 0), (2, 3), (3, 1)):
            np.testing.assert_array_equal(scene.shifted(dx, dy, spp=spp), light, f"{seed}")


@pytest.mark.parametrize("zoom", [1.0, 30.0, 1000.0, 30000.0])
def test_a_pixel_does_not_depend_on_its_neighbours(zoom: float) -> None:
    check_shifts(range(60), zoom)


def test_a_pixel_of_a_physical_material_does_not_depend_on_its_neighbours() -> None:
    check_shifts(range(40), 1.0, rich=True)


@pytest.mark.slow
@pytest.mark.parametrize("zoom", [1.0, 30.0, 1000.0, 30000.0])
def test_a_pixel_does_not_depend_on_its_neighbours_in_many_scenes(zoom: float) -> None:
    check_shifts(range(1000, 1500), zoom)


def test_four_samples_are_the_mean_of_four_shifted_pictures() -> None:
    # where they lie: the rotated grid, in quarters of a pixel
    places = ((0.125, 0.625), (0.375, 0.125), (0.625, 0.875), (0.875, 0.375))
    for seed in range(40):
        stage = RandomStage(seed, flat=False)
        # without textures: their sharpness goes by the number of samples
        bare = tuple(replace(surface, texture=-1) for surface in stage.scene.surfaces)
        stage.scene = replace(stage.scene, surfaces=bare, skybox=-1)
        frame, camera = stage.snapshot(), stage.camera
        shifts = [
            replace(camera, cx=camera.cx + 0.5 - x, cy=camera.cy + 0.5 - y) for x, y in places
        ]
        # outlines cover a part of each quarter, or of the pixel
        *apart, light = (
            NativeRenderer(
                stage.scene,
                moved,
                RenderConfig(spp=spp, antialiasing="fixed"),
                1,
                switches=SAMPLED_OUTLINES,
            )
            .render(frame, stage.pose)
            .copy()
            for moved, spp in [*((shift, 1) for shift in shifts), (camera, 4)]
        )
        total = sum(apart, np.float32(0))
        np.testing.assert_array_equal(light, total * np.float32(0.25), f"{seed}")


def test_light_adds_up_over_the_lights() -> None:
    for seed in range(60):
        stage = RandomStage(seed)
        if len(stage.scene.lights) < 2:
            continue
        stage.scene = replace(stage.scene, skybox=-1)
        stage.scene = replace(
            stage.scene,
            surfaces=tuple(replace(surface, emission=0.0) for surface in stage.scene.surfaces),
        )
        whole = stage.renderer().render(stage.snapshot(), stage.pose).astype(np.float64)
        every, positions, directions = stage.scene.lights, stage.light_pos, stage.light_dir
        total = np.zeros_like(whole)
        for index, light in enumerate(every):
            stage.scene = replace(stage.scene, lights=(light,))
            stage.light_pos, stage.light_dir = positions[[index]], directions[[index]]
            total += stage.renderer().render(stage.snapshot(), stage.pose)
        # each of the sums is rounded to float32, and coloured scenes weigh three channels
        np.testing.assert_allclose(whole, total, rtol=5e-5, atol=1e-6, err_msg=f"{seed}")
