"""Every sampler of `path` against the density that it states, and that against ours: chi-square."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy

from evs.emulator import _core
from evs.emulator.base.scene import CameraPose, Shape
from reference.chi_square import p_of_counts, p_of_directions
from reference.closed_forms import ggx_density
from reference.our_light import path_caster
from reference.path_stages import sunset
from reference.stage import EYE, Builder, Stage, matt, turned
from reference.tessellation import ball, sheet

pytestmark = pytest.mark.statistical
SAMPLERS = ("owen", "sobol", "global", "random", "anchored")
LEAST = 1e-4
"""A sampler that is right is refused by one of ten thousand seeds."""
DRAWS = 1 << 17


def points(sampler: str, index: int, dimension: int, pixels: np.ndarray, **more: int) -> np.ndarray:
    """(n, 2) float64 points of these pixels."""
    out = np.zeros((len(pixels), 2), np.float32)
    settings = {"seed": 7, "log2_samples": 6, **more}
    _core.probe_sampler(sampler, index, dimension, pixels.astype(np.int32), out, **settings)
    return out.astype(np.float64)


@pytest.mark.parametrize("sampler", ["owen", "sobol", "random", "anchored"])
def test_points_are_uniform_over_the_pixels_and_independent_between_dimensions(
    sampler: str,
) -> None:
    pixels = np.arange(DRAWS)
    for index in (0, 1, 37):
        found = {k: points(sampler, index, k, pixels) for k in (0, 1, 4, 1024)}
        for a in found.values():
            assert a.min() >= 0
            assert a.max() < 1
            counts = np.histogram2d(*a.T, bins=32, range=[[0, 1]] * 2)[0]
            assert p_of_counts(counts, np.full((32, 32), DRAWS / 1024)) > LEAST
        for k, m in ((0, 1), (0, 4), (1, 1024)):
            pair = found[k][:, 0], found[m][:, 0]
            counts = np.histogram2d(*pair, bins=32, range=[[0, 1]] * 2)[0]
            assert p_of_counts(counts, np.full((32, 32), DRAWS / 1024)) > LEAST
    # and between samples that follow each other
    if sampler == "random":
        pair = points(sampler, 0, 0, pixels)[:, 0], points(sampler, 1, 0, pixels)[:, 0]
        counts = np.histogram2d(*pair, bins=32, range=[[0, 1]] * 2)[0]
        assert p_of_counts(counts, np.full((32, 32), DRAWS / 1024)) > LEAST


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_points_of_a_pixel_fill_the_square_evenly(sampler: str) -> None:
    pixels = np.arange(64)
    for dimension in (0, 3, 2048):
        found = np.stack([points(sampler, i, dimension, pixels) for i in range(64)], 1)
        # Sobol's points: one in each of the 64 boxes of any shape; shifted ones too on a torus
        for across in range(7):
            boxes = 2**across, 2 ** (6 - across)
            cell = np.floor(found * boxes).astype(int)
            taken = [len({(x, y) for x, y in one}) for one in cell.tolist()]
            if sampler in ("owen", "global", "anchored"):
                assert min(taken) == 64
        if sampler == "sobol":
            # the shift takes them off the boxes, not out of step: sorted, no gap is over 1 / 32
            for axis in (0, 1):
                ordered = np.sort(found[..., axis], 1)
                assert np.diff(ordered, axis=1).max() <= 1 / 64 + 1e-6
        if sampler == "global":
            np.testing.assert_array_equal(found, np.broadcast_to(found[:1], found.shape))
        else:
            assert len(np.unique(found[:, 0, 0])) > 60


def test_seeds_and_samples_are_new_points() -> None:
    pixels = np.arange(4096)
    for sampler in ("owen", "sobol", "random"):
        a, b = (points(sampler, 0, 2, pixels, seed=s) for s in (1, 2))
        assert abs(scipy.stats.pearsonr(a[:, 0], b[:, 0])[0]) < 4.5 / np.sqrt(4096)
        assert (a != b).any(1).mean() > 0.99


SURFACES: dict[str, dict[str, Any]] = {
    "matt": {},
    "gloss": {"f0": 0.04, "alpha": 0.35},
    "polished": {"f0": 0.5, "alpha": 0.08},
    "metal": {"f0": 0.9, "alpha": 0.4, "metallic": 1.0},
    "rough metal": {"f0": 0.9, "alpha": 1.0, "metallic": 1.0},
    "half a mirror": {"f0": 0.1, "alpha": 0.5, "mirror": 0.5},
}


def surface_of(eye: np.ndarray, **more: float) -> dict[str, Any]:
    told = {"albedo": 0.6, "f0": 0.0, "metallic": 0.0, "alpha": 0.5, "mirror": 0.0, **more}
    return told | {"eye": tuple(float(e) for e in eye)}


def scattered(surface: dict[str, Any], seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    numbers = rng.random((DRAWS, 4), np.float32)
    found = {
        "direction": np.zeros((DRAWS, 3), np.float32),
        "light": np.zeros((DRAWS, 3), np.float32),
        "density": np.zeros(DRAWS, np.float32),
        "again": np.zeros(DRAWS, np.float32),
        "mirrored": np.zeros(DRAWS, np.int32),
        "alive": np.zeros(DRAWS, np.int32),
    }
    _core.probe_bsdf_sample(*surface.values(), numbers, *found.values())
    return {key: value.astype(np.float64) for key, value in found.items()}


def evaluated(surface: dict[str, Any], directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f cos and density of (..., 3) directions."""
    flat = np.ascontiguousarray(directions.reshape(-1, 3), np.float32)
    light, density = np.zeros((len(flat), 3), np.float32), np.zeros(len(flat), np.float32)
    _core.probe_bsdf(*surface.values(), flat, light, density)
    shape = directions.shape[:-1]
    return light.astype(np.float64).reshape(*shape, 3), density.astype(np.float64).reshape(shape)


@pytest.mark.parametrize("degrees", [0.0, 45.0, 80.0])
@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_draws_from_its_density(name: str, degrees: float) -> None:
    tilt = np.deg2rad(degrees)
    eye = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    surface = surface_of(eye, **SURFACES[name])
    found = scattered(surface, 3)
    mirrored, alive = found["mirrored"] == 1, found["alive"] == 1
    # the mirror has its share, and shows the mirror's direction
    share = surface["mirror"]
    count = scipy.stats.binomtest(int(mirrored.sum()), DRAWS, share) if share else None
    assert count is None or count.pvalue > LEAST
    shown = found["direction"][mirrored]
    np.testing.assert_allclose(shown, np.tile(eye * [-1, -1, 1], (len(shown), 1)), atol=1e-5)

    # what is drawn otherwise: its density is stated to the ray too, and it is what was drawn from
    others = alive & ~mirrored
    np.testing.assert_allclose(found["again"][others], found["density"][others], rtol=1e-4)
    lost = int((~mirrored).sum() - others.sum())
    p = p_of_directions(
        found["direction"][others], lambda w: evaluated(surface, w)[1] / (1 - share), lost
    )
    assert p > LEAST
    # throughput is f cos / density
    light, density = evaluated(surface, found["direction"][others])
    np.testing.assert_allclose(
        found["light"][others], light / density[:, None], rtol=1e-3, atol=1e-6
    )


@pytest.mark.parametrize("degrees", [0.0, 45.0, 80.0])
def test_the_glossy_lobe_is_that_of_visible_facets(degrees: float) -> None:
    tilt = np.deg2rad(degrees)
    eye = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    surface = surface_of(eye, f0=1.0, metallic=1.0, alpha=0.4)
    rng = np.random.default_rng(5)
    w = rng.normal(size=(20_000, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    expected = np.where(w[:, 2] > 0, ggx_density(eye, w, 0.4), 0.0)
    np.testing.assert_allclose(evaluated(surface, w)[1], expected, rtol=2e-3, atol=1e-6)


def aims(stage: Stage, point: Any, sky: bool) -> tuple[np.ndarray, ...]:
    """What a point aims at: directions, radiance, density, and the density as a ray is told it."""
    caster, poses = path_caster(stage)
    numbers = np.random.default_rng(11).random((DRAWS, 3), np.float32)
    direction, light = (np.zeros((DRAWS, 3), np.float32) for _ in range(2))
    density, again = (np.zeros(DRAWS, np.float32) for _ in range(2))
    _core.probe_light_sample(caster, *poses, point, sky, numbers, direction, light, density, again)
    return tuple(a.astype(np.float64) for a in (direction, light, density, again))


def told(stage: Stage, point: Any, w: np.ndarray) -> np.ndarray:
    """The density that rays from a point along w (..., 3) are told for what they meet."""
    caster, poses = path_caster(stage)
    flat = np.ascontiguousarray(w.reshape(-1, 3), np.float32)
    found = np.zeros(len(flat), np.float32)
    _core.probe_light_pdf(caster, *poses, point, flat, found)
    return found.astype(np.float64).reshape(w.shape[:-1])


def at_the_origin(stage: Stage) -> Stage:
    """The camera's frame is the world's."""
    return replace(stage, pose=CameraPose(np.zeros(3), EYE.ravel()))


LAMPS: dict[str, tuple[Shape, tuple[float, ...]]] = {
    "ball": (Shape.SPHERE, (0.5,)),
    "panel": (Shape.PLANE, (0.7, 0.3, 1.0)),
    "box": (Shape.BOX, (0.5, 0.3, 0.2)),
    "cylinder": (Shape.CYLINDER, (0.3, 0.5)),
    "capsule": (Shape.CAPSULE, (0.3, 0.4)),
    "ellipsoid": (Shape.ELLIPSOID, (0.6, 0.2, 0.4)),
    "mesh": (Shape.MESH, (1.0, 1.0, 1.0)),
    "sheet": (Shape.MESH, (1.0, 1.0, 1.0)),
}


@pytest.mark.parametrize("name", LAMPS)
def test_a_lamp_is_aimed_at_by_its_density(name: str) -> None:
    shape, size = LAMPS[name]
    mesh = {"mesh": ball(5, (0.5, 0.4, 0.6), smooth=False), "sheet": sheet((0.6, 0.4), (1, 1))}
    made = Builder()
    turn = turned((1, 2, 0), 150)
    made.add(shape, size, (0.2, 0.3, 1.6), matt(1.0, emission=2.0), turn=turn, mesh=mesh.get(name))
    # another lamp, on the other side, has its share of the draws
    made.add(Shape.SPHERE, (0.2,), (0, 0, -2), matt(1.0, emission=2.0))
    stage = at_the_origin(made.look((0, 0, 0), (0, 0, -1), size=(4, 4), path=True))
    point = (0.1, -0.1, 0.2)
    direction, light, density, again = aims(stage, point, sky=False)
    drawn = density > 0
    np.testing.assert_allclose(light[drawn], 2.0, rtol=1e-5)
    assert 0.01 < (direction[drawn][:, 2] < 0).mean() < 0.5
    # a ray that finds the lamp by chance is told the same, but where it grazes an edge
    met = drawn & (again > 0)
    assert met.sum() > 0.99 * drawn.sum()
    assert np.isclose(again[met], density[met], rtol=0.02).mean() > 0.99
    # and it is drawn from what is told
    p = p_of_directions(
        direction[drawn], lambda w: told(stage, point, w), int((~drawn).sum()), (96, 192)
    )
    assert p > LEAST


@pytest.mark.parametrize("name", ["ball", "panel", "sheet"])
def test_the_density_of_a_lamp_in_closed_form(name: str) -> None:
    # straight above: a cone, or a rectangle of 4 a b
    shape, size = LAMPS[name]
    mesh = sheet((0.6, 0.4), (1, 1)) if name == "sheet" else None
    down = np.diag([1.0, -1.0, -1.0])
    made = Builder()
    made.add(shape, size, (0, 0, 1.5), matt(1.0, emission=1.0), turn=down, mesh=mesh)
    stage = at_the_origin(made.look((0, 0, 0), (0, 0, -1), size=(4, 4), path=True))
    direction, _, density, _ = aims(stage, (0.0, 0.0, 0.0), sky=False)
    cosine = direction[:, 2]
    if name == "ball":
        expected = 1 / (2 * np.pi * (1 - np.sqrt(1 - (0.5 / 1.5) ** 2)))
    else:
        a, b = size[:2] if name == "panel" else (0.6, 0.4)
        expected = 1.5**2 / cosine**3 / (4 * a * b)
    np.testing.assert_allclose(density, np.broadcast_to(expected, density.shape), rtol=1e-3)


def test_the_sky_is_aimed_at_by_its_density() -> None:
    shown = sunset()
    made = Builder(textures=list(shown.scene.textures), skybox=shown.scene.skybox)
    # nothing is in the way, or nearly
    made.add(Shape.SPHERE, (1e-3,), (0, 0, -1e3), matt(0.5))
    stage = at_the_origin(made.look((0, 0, 0), (0, 0, -1), size=(4, 4), path=True))
    point = (0.0, 0.0, 0.0)
    direction, light, density, again = aims(stage, point, sky=True)
    assert (density > 0).all()
    np.testing.assert_allclose(again, density, rtol=1e-3)
    np.testing.assert_allclose(light, shown.sky_radiance(direction), rtol=0.02, atol=0.004)
    assert p_of_directions(direction, lambda w: told(stage, point, w), 0, (48, 96)) > LEAST
    # where it is bright it is aimed at more often
    assert scipy.stats.spearmanr(density, light @ [0.2126, 0.7152, 0.0722])[0] > 0.8
