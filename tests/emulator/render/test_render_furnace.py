"""`path` in scenes whose light can be written down: furnaces, cavities, form factors, exchange."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.emulator.base.scene import LightKind, Shape, Surface
from reference.closed_forms import ggx, ggx_albedo, of_rectangle, of_sphere, of_wall
from reference.our_light import path_batches
from reference.pixelwise import assert_same_picture
from reference.stage import EYE, Builder, Stage, matt, turned
from reference.tessellation import ball, sheet

pytestmark = [pytest.mark.slow, pytest.mark.statistical]
DOWN = np.diag([1.0, -1.0, -1.0])
SIZES = {
    Shape.SPHERE: (0.7,),
    Shape.CAPSULE: (0.6, 0.5),
    Shape.ELLIPSOID: (0.9, 0.7, 0.6),
    Shape.CYLINDER: (0.7, 0.6),
    Shape.BOX: (0.8, 0.7, 0.6),
    Shape.MESH: (1.0, 1.0, 1.0),
}
SIZE = (24, 18)
CLOUDS = (0.7, 0.7, 0.7)


def look(made: Builder, eye: Any, at: Any, bounces: int, **more: Any) -> Stage:
    return made.look(eye, at, size=SIZE, bounces=bounces, path=True, **more)


def clouds(made: Builder) -> None:
    """The same light from all sides."""
    made.shine(LightKind.DIRECTIONAL, diffuse=(0, 0, 0), ambient=CLOUDS)


def mean_of(function: Callable[[np.ndarray, np.ndarray], np.ndarray], width_m: float) -> np.ndarray:
    """A function of x and y on the floor, averaged over each pixel of `from_above`."""
    node, weight = np.polynomial.legendre.leggauss(3)
    step, total = width_m / SIZE[0], np.zeros(SIZE[::-1])
    for dx, wx in zip(node / 2, weight / 2, strict=True):
        for dy, wy in zip(node / 2, weight / 2, strict=True):
            x = (np.arange(SIZE[0]) + 0.5 + dx - SIZE[0] / 2) * step
            y = (SIZE[1] / 2 - np.arange(SIZE[1]) - 0.5 - dy) * step
            total += wx * wy * function(*np.meshgrid(x, y))
    return total


def from_above(made: Builder, height: float, bounces: int, width_m: float = 1.0) -> Stage:
    """Straight down from a height, so that what is above it does not hide what is below."""
    tall = width_m * SIZE[1] / SIZE[0]
    return look(made, (0, 0, height), (0, 0, 0), bounces, fovy_deg=tall, orthographic=True)


def assert_is(
    stage: Stage,
    expected: Any,
    tmp_path: Path,
    batches: int = 16,
    spp: int = 64,
    sharp: float = 0.01,
) -> None:
    """The light of the stage is `expected`, per pixel or the same in all, within its noise."""
    light = path_batches(stage, batches, spp)
    known = np.broadcast_to(np.asarray(expected, np.float64), light.shape)
    assert_same_picture("light", light, np.array(known), tmp_path, sharp)


def assert_mean_is(stage: Stage, expected: float) -> None:
    """The mean light is `expected`, within its noise and 2e-4 of quadrature."""
    means = path_batches(stage, 16, 64).mean((1, 2)) / expected
    error = means.std(ddof=1) / 4
    assert error < 0.002, "too noisy"
    assert abs(means.mean() - 1) < 4 * error + 2e-4


@pytest.mark.parametrize("bounces", [0, 3])
@pytest.mark.parametrize("albedo", [1.0, 0.4])
@pytest.mark.parametrize("shape", SIZES)
def test_a_convex_body_in_even_light(
    shape: Shape, albedo: float, bounces: int, tmp_path: Path
) -> None:
    # nothing of it sees anything of it: albedo times the light of the sky
    made = Builder()
    mesh = ball(12, (0.7, 0.6, 0.7), smooth=False) if shape is Shape.MESH else None
    made.add(shape, SIZES[shape], (0, 0, 0), matt(albedo), turn=turned((1, 1, 0), 35), mesh=mesh)
    clouds(made)
    stage = look(made, (0.2, -4, 1), (0, 0, 0), bounces, fovy_deg=10.0)
    assert_is(stage, albedo * CLOUDS[0], tmp_path)


def test_a_mirror_has_no_image_of_ambient_light(tmp_path: Path) -> None:
    # as in MuJoCo's picture: a mirror takes nothing from its surface, unless that is physical
    for surface, lit in (
        (matt(0.8, reflectance=0.75), 0.8),
        (matt(0.8, reflectance=1.0), 0.8),
        (matt(0.8, reflectance=0.75, metallic=0.0, roughness=0.1), 0.25 * (0.96 * 0.8 + 0.04)),
    ):
        made = Builder()
        made.add(Shape.SPHERE, (0.7,), (0, 0, 0), surface)
        clouds(made)
        stage = look(made, (0.2, -4, 1), (0, 0, 0), 1, fovy_deg=10.0)
        assert_is(stage, lit * CLOUDS[0], tmp_path)


@pytest.mark.parametrize("degrees", [0.0, 50.0, 75.0])
@pytest.mark.parametrize("shininess", [0.0, 0.1, 1.0])
def test_gloss_in_even_light(shininess: float, degrees: float, tmp_path: Path) -> None:
    # (1 - F0) albedo + F0 times what a single scattering off the facets gives back
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(0.3, specular=1.0, shininess=shininess))
    clouds(made)
    tilt = np.deg2rad(degrees)
    eye = (0.0, -3 * np.sin(tilt), 3 * np.cos(tilt))
    stage = look(made, eye, (0, 0, 0), 0, fovy_deg=0.5, orthographic=True)
    alpha = float(np.sqrt(2 / (128 * shininess + 2)))
    share = 0.92 * 0.3 + 0.08 * ggx_albedo(float(np.cos(tilt)), alpha)
    assert_is(stage, CLOUDS[0] * share, tmp_path, spp=256, sharp=0.002)


@pytest.mark.parametrize("degrees", [0.0, 60.0])
@pytest.mark.parametrize("roughness", [0.4, 0.6, 1.0])
def test_rough_metal_in_even_light_loses_what_facets_reflect_twice(
    roughness: float, degrees: float
) -> None:
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(1.0, metallic=1.0, roughness=roughness))
    clouds(made)
    tilt = np.deg2rad(degrees)
    eye = (0.0, -3 * np.sin(tilt), 3 * np.cos(tilt))
    stage = look(made, eye, (0, 0, 0), 2, fovy_deg=0.5, orthographic=True)
    assert_mean_is(stage, CLOUDS[0] * ggx_albedo(float(np.cos(tilt)), roughness**2, 150))


def test_the_page_says_how_much_rough_metal_loses(pytestconfig: pytest.Config) -> None:
    page = (pytestconfig.rootpath / "docs" / "explanation" / "light.md").read_text("utf-8")
    albedos = [f"{ggx_albedo(1.0, roughness**2, 150):.2f}" for roughness in (0.4, 0.6, 1.0)]
    said = "reflects {}, {} and {} of uniform light at roughness 0.4, 0.6 and 1".format(*albedos)
    assert said in " ".join(page.split())


@pytest.mark.parametrize("roughness", [0.05, 0.2, 0.5])
def test_a_metal_reflects_a_wide_bulb(roughness: float) -> None:
    # its mirror image is in the middle of the bulb
    distance, radius, strength = 2.0, 0.4, 3.0
    eye, bulb = np.array([0, -0.8, 0.6]), np.array([0, 0.8, 0.6])
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(1.0, metallic=1.0, roughness=roughness))
    place = tuple(distance * bulb)
    made.shine(LightKind.POINT, place, diffuse=(strength,) * 3, bulbradius_m=radius)
    stage = look(made, tuple(eye), (0, 0, 0), 0, fovy_deg=0.002, orthographic=True)
    # integrate over the cone of the bulb, with more nodes in its middle
    node, weight = np.polynomial.legendre.leggauss(200)
    u = (node + 1) / 2
    angle, turn = np.arcsin(radius / distance) * u**2, np.pi * (node + 1)
    across, up = np.array([1.0, 0, 0]), np.cross(bulb, [1.0, 0, 0])
    around = np.cos(turn)[:, np.newaxis] * across + np.sin(turn)[:, np.newaxis] * up
    w = np.cos(angle)[:, np.newaxis, np.newaxis] * bulb
    w = w + np.sin(angle)[:, np.newaxis, np.newaxis] * around
    step = np.arcsin(radius / distance) * u * weight * np.sin(angle)
    f_cos = ggx(np.broadcast_to(eye, w.shape), w, roughness**2) * w[..., 2]
    share = np.einsum("ij,i,j->", f_cos, step, np.pi * weight)
    assert_mean_is(stage, strength / radius**2 * share)


@pytest.mark.parametrize("shininess", [0.0, 0.05, 0.5])
def test_gloss_in_the_sun_is_ggx_and_reciprocal(shininess: float) -> None:
    alpha = float(np.sqrt(2 / (128 * shininess + 2)))
    angles = [(10.0, 0.0), (35.0, 180.0), (60.0, 120.0), (80.0, 170.0), (40.0, 10.0)]
    ways = [np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
            for a, b in np.deg2rad(angles)]  # fmt: skip
    found = np.zeros((len(ways), len(ways)))
    for i, eye in enumerate(ways):
        for j, sun in enumerate(ways):
            made = Builder()
            look_of = matt(0.3, specular=1.0, shininess=shininess)
            made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), look_of)
            made.shine(LightKind.DIRECTIONAL, towards=tuple(-sun), diffuse=(1, 1, 1))
            stage = look(made, tuple(3 * eye), (0, 0, 0), 0, fovy_deg=0.5, orthographic=True)
            light = path_batches(stage, 1, 4)[0]
            # hard light on one direction: nothing is random
            np.testing.assert_allclose(light, light[0, 0], rtol=1e-4)
            found[i, j] = light.mean() / (np.pi * sun[2])
            expected = 0.92 * 0.3 / np.pi + 0.08 * ggx(eye, sun, alpha)
            np.testing.assert_allclose(found[i, j], expected, rtol=2e-4)
    np.testing.assert_allclose(found, found.T, rtol=2e-4)


@pytest.mark.parametrize("albedo", [0.3, 0.8])
@pytest.mark.parametrize("bounces", [0, 1, 2, 6])
def test_a_glowing_cavity_is_a_geometric_series(
    bounces: int, albedo: float, tmp_path: Path
) -> None:
    # six walls that face inwards; what they give off comes back bounces + 1 times
    made = Builder()
    wall = matt(albedo, emission=0.5)
    for axis, degrees in (((1, 0, 0), 0), ((1, 0, 0), 180), ((1, 0, 0), 90), ((1, 0, 0), -90),
                          ((0, 1, 0), 90), ((0, 1, 0), -90)):  # fmt: skip
        turn = turned(axis, degrees)
        made.add(Shape.PLANE, (1.01, 1.01, 1), tuple(-turn[:, 2]), wall, turn=turn)
    stage = look(made, (0.3, -0.4, 0.2), (-0.5, 0.6, -0.1), bounces, fovy_deg=100.0)
    series = sum(albedo**k for k in range(bounces + 2))
    assert_is(stage, 0.5 * albedo * series, tmp_path)


def test_a_cavity_of_triangles(tmp_path: Path) -> None:
    # a ball turned inside out, each of its 256 triangles a lamp
    made = Builder()
    outside = ball(8, (1, 1, 1), smooth=False)
    inside = replace(outside, faces=np.ascontiguousarray(outside.faces[:, ::-1]))
    made.add(Shape.MESH, (1, 1, 1), (0, 0, 0), matt(0.6, emission=1.0), mesh=inside)
    stage = look(made, (0.3, -0.4, 0.2), (-0.5, 0.6, -0.1), 3, fovy_deg=80.0)
    assert_is(stage, 0.6 * sum(0.6**k for k in range(5)), tmp_path)


@pytest.mark.parametrize("kind", ["ball", "lamp"])
def test_a_ball_of_light_over_a_floor(kind: str, tmp_path: Path) -> None:
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(0.5))
    if kind == "ball":
        made.add(Shape.SPHERE, (0.3,), (0, 0, 0.6), matt(1.0, emission=2.0))
    else:
        # the lamp of the same strength: radiance times pi r^2 is its intensity, pi the unit's
        strength = 2.0 * 0.3**2
        made.shine(LightKind.POINT, (0, 0, 0.6), diffuse=(strength,) * 3, bulbradius_m=0.3)
    expected = 0.5 * 2.0 * mean_of(lambda x, y: of_sphere(x, y, 0.3, 0.6), 1.0)
    assert expected.max() > 2 * expected.min()
    assert_is(from_above(made, 0.2, 0), expected, tmp_path)


@pytest.mark.parametrize("shape", [Shape.PLANE, Shape.MESH])
def test_a_panel_over_a_floor(shape: Shape, tmp_path: Path) -> None:
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(0.5))
    glow = matt(1.0, emission=2.0)
    if shape is Shape.PLANE:
        made.add(Shape.PLANE, (0.4, 0.2, 1), (0, 0, 0.5), glow, turn=DOWN)
    else:
        mesh = replace(sheet((0.4, 0.2), (1, 1)), texcoords=None)
        made.add(Shape.MESH, (1, 1, 1), (0, 0, 0.5), glow, turn=DOWN, mesh=mesh)
    expected = 0.5 * 2.0 * mean_of(lambda x, y: of_rectangle(x, y, (0.4, 0.2), 0.5), 1.0)
    assert_is(from_above(made, 0.2, 0), expected, tmp_path)


def test_a_wall_hides_its_share_of_the_clouds(tmp_path: Path) -> None:
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), matt(0.5))
    made.add(Shape.PLANE, (1000, 0.5, 1), (0, 1, 0.5), matt(0.0), turn=turned((1, 0, 0), 90))
    clouds(made)
    expected = 0.5 * CLOUDS[0] * mean_of(lambda x, y: 1 - of_wall(1 - y, 1.0), 1.0)
    assert expected.max() > 1.1 * expected.min()
    assert_is(from_above(made, 0.7, 2), expected, tmp_path)


def test_what_one_gives_the_other_the_other_gives_the_one(tmp_path: Path) -> None:
    # A1 F12 = A2 F21, through renders that exchange lamp and receiver
    sizes, places = ((0.4, 0.3), (0.1, 0.2)), ((0.0, 0.0, 0.0), (0.3, 0.2, 0.5))
    turns = (EYE, turned((1, 0.3, 0), 150))
    given = []
    for receiver in (0, 1):
        made = Builder()
        for k in (0, 1):
            look_of = matt(1.0, emission=0.0 if k == receiver else 1.0)
            made.add(Shape.PLANE, (*sizes[k], 1), places[k], look_of, turn=turns[k])
        # something between them, and the eye before that
        made.add(Shape.SPHERE, (0.08,), (0.1, 0.15, 0.25), matt(0.0))
        half, turn = sizes[receiver], turns[receiver]
        eye = np.array(places[receiver]) + 0.02 * turn[:, 2]
        stage = look(made, tuple(eye), places[receiver], 0, fovy_deg=2.0, orthographic=True)
        focal = (SIZE[0] / 2 / half[0], SIZE[1] / 2 / half[1])
        stage = replace(
            stage,
            camera=replace(stage.camera, fx=focal[0], fy=focal[1]),
            pose=replace(stage.pose, mat=turn.ravel()),
        )
        light = path_batches(stage, 16, 256)
        given.append(light * 4 * half[0] * half[1])
    means = [g.mean((1, 2)) for g in given]
    assert_same_picture("exchange", *(m[:, None, None] for m in means), tmp_path)


def test_a_surface_that_would_give_more_than_it_gets_gives_what_it_gets(tmp_path: Path) -> None:
    # a white floor whose material asks for a gloss beside
    made = Builder()
    made.add(Shape.PLANE, (0, 0, 1), (0, 0, 0), Surface((1, 1, 1, 1), specular=1.0, shininess=0.9))
    clouds(made)
    light = path_batches(look(made, (0, -2, 1), (0, 0, 0), 4, fovy_deg=5.0), 4, 64)
    assert light.mean() <= CLOUDS[0]
    assert light.mean() > 0.95 * CLOUDS[0]
