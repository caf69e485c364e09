"""Lens models against OpenCV, whose functions this project does not use."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from evs.emulator.base.scene import CameraModel
from evs.emulator.optics import MODELS, make_lens, project
from evs.emulator.optics.lens import rays
from evs.msgs import EvsError

WIDTH, HEIGHT = 346, 260
PINHOLE = CameraModel(WIDTH, HEIGHT, 291.0, 288.0, 175.3, 127.9)
LENSES = {
    "mild": replace(
        PINHOLE, distortion_model="plumb_bob", distortion=(-0.31, 0.12, 0.0011, -0.0007, -0.02)
    ),
    "pincushion": replace(
        PINHOLE, distortion_model="plumb_bob", distortion=(0.4, 0.2, -0.004, 0.006, 0.1)
    ),
    "rational": replace(
        PINHOLE,
        fx=171.0,
        fy=172.0,
        distortion_model="rational_polynomial",
        distortion=(0.61, 0.11, 0.0003, -0.0002, 0.008, 0.98, 0.29, 0.03),
    ),
    "fisheye": replace(
        PINHOLE,
        fx=150.0,
        fy=151.0,
        distortion_model="equidistant",
        distortion=(0.02, -0.006, 0.003, -0.0009),
    ),
}
"""coefficients as calibrations give them, from weak to strong"""
LENS = pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)


def opencv(camera: CameraModel, points: np.ndarray) -> np.ndarray:
    """(n, 2) px, (0, 0) the first pixel's corner, of points (n, 3) before the camera."""
    x, y, z = points.T
    seen = np.ascontiguousarray(np.stack([x, -y, -z], 1)[:, np.newaxis])
    matrix = np.array([[camera.fx, 0, camera.cx - 0.5], [0, camera.fy, camera.cy - 0.5], [0, 0, 1]])
    turn = shift = np.zeros(3)
    d = np.array(camera.distortion)
    if camera.distortion_model == "equidistant":
        found = cv2.fisheye.projectPoints(seen, turn, shift, matrix, d)[0]
    else:
        found = cv2.projectPoints(seen, turn, shift, matrix, d)[0]
    # the centre of OpenCV's first pixel is 0
    return found[:, 0] + 0.5


@LENS
def test_points_appear_where_opencv_has_them(camera: CameraModel) -> None:
    rng = np.random.default_rng(1)
    slopes = rng.uniform(-0.5, 0.5, (1000, 2))
    points = np.column_stack([slopes, -np.ones(1000)]) * rng.uniform(0.1, 50, (1000, 1))
    np.testing.assert_allclose(project(camera, points), opencv(camera, points), atol=1e-9)


@LENS
def test_the_ray_of_an_image_point_leads_back_to_it(camera: CameraModel) -> None:
    x, y = np.meshgrid(np.linspace(0, WIDTH, 41), np.linspace(0, HEIGHT, 31))
    directions, outside = rays(camera, x, y)
    assert not outside.any()
    image = opencv(camera, directions.reshape(-1, 3))
    np.testing.assert_allclose(image, np.stack([x, y], -1).reshape(-1, 2), atol=1e-8)


def worst_px(camera: CameraModel, widest: float = np.pi) -> float:
    """Largest error of what is interpolated between corners, px, up to `widest` off the axis."""
    table = make_lens(camera)
    lens = table.directions
    assert lens is not None
    worst = 0.0
    for u, v in ((0.5, 0.5), (0.5, 0.0), (0.0, 0.5), (0.25, 0.7)):
        top = lens[:-1, :-1] + (lens[:-1, 1:] - lens[:-1, :-1]) * u
        bottom = lens[1:, :-1] + (lens[1:, 1:] - lens[1:, :-1]) * u
        mixed = (top + (bottom - top) * v).reshape(-1, 3).astype(np.float64)
        x, y = np.meshgrid(np.arange(camera.width) + u, np.arange(camera.height) + v)
        error = np.hypot(*(project(camera, mixed) - np.stack([x, y], -1).reshape(-1, 2)).T)
        seen = np.arccos(-mixed[:, 2] / np.linalg.norm(mixed, axis=1)) <= widest
        if table.outside is not None:
            seen &= ~table.outside.ravel()
        error = error[seen]
        worst = max(worst, float(error.max()))
    return worst


@LENS
def test_interpolated_rays_are_right_to_a_hundredth_of_a_pixel(camera: CameraModel) -> None:
    # measured: 0.0007 (plumb_bob) to 0.004, as lens.py says
    assert worst_px(camera) < 0.0045


def test_the_error_falls_with_the_resolution() -> None:
    # per pixel: the curvature in a pixel falls with the square, a pixel with the first power
    camera = LENSES["fisheye"]
    double = replace(
        camera, width=692, height=520, fx=300, fy=302, cx=2 * camera.cx, cy=2 * camera.cy
    )
    assert worst_px(double) < 0.6 * worst_px(camera)


def wide(degrees: float, size: int = 200) -> CameraModel:
    """An ideal fisheye whose image circle of `degrees` touches the picture's sides."""
    focal = size / np.radians(degrees)
    return CameraModel(
        size, size, focal, focal, size / 2, size / 2, False, "equidistant", (0.0,) * 4
    )


@pytest.mark.parametrize("degrees", [180, 220, 300])
def test_a_fisheye_sees_behind_itself(degrees: float) -> None:
    camera = wide(degrees)
    x = np.arange(201.0)
    directions, outside = rays(camera, x, np.full(201, 100.0))
    angle = np.radians(degrees) / 2 * (x - 100) / 100
    expected = np.stack([np.sin(angle), np.zeros(201), -np.cos(angle)], -1)
    np.testing.assert_allclose(directions, expected, atol=1e-12)
    assert not outside.any()
    # past 160 degrees off the axis everything runs together in one point
    assert worst_px(camera, np.radians(160)) < 0.013


def test_pixels_beyond_the_image_circle_are_outside() -> None:
    # pi is at 100 px, and the corners of the picture are further away
    lens = make_lens(wide(360))
    assert lens.outside is not None
    assert lens.share is not None
    x, y = np.meshgrid(np.arange(200) + 0.5, np.arange(200) + 0.5)
    r = np.hypot(x - 100, y - 100)
    assert lens.outside[r > 100].all()
    # 0.71, half a diagonal: a pixel is out as soon as one of its corners is
    assert not lens.outside[r < 100 - 0.71].any()
    np.testing.assert_array_equal(lens.share, ~lens.outside)


def test_a_fisheye_ends_where_its_polynomial_turns() -> None:
    camera = replace(wide(200), distortion=(-0.2, 0.0, 0.0, 0.0))
    # d/dt (t - 0.2 t^3) = 0
    turn = np.sqrt(1 / 0.6)
    rim_px = camera.fx * (turn - 0.2 * turn**3)
    lens = make_lens(camera)
    assert lens.outside is not None
    x = np.arange(200) + 0.5 - 100
    np.testing.assert_array_equal(lens.outside[100], np.hypot(np.abs(x) + 0.5, 1.0) > rim_px)
    at_rim = np.array([[np.sin(a), 0.0, -np.cos(a)] for a in (turn - 1e-6, turn + 1e-6)])
    image = project(camera, at_rim)
    np.testing.assert_allclose(image[0], [100 + rim_px, 100], atol=1e-6)
    assert np.isnan(image[1]).all()


def test_zero_coefficients_are_no_lens() -> None:
    for model, count in (("plumb_bob", 5), ("rational_polynomial", 8)):
        camera = replace(PINHOLE, distortion_model=model, distortion=(0.0,) * count)
        assert make_lens(camera).directions is None
    assert make_lens(PINHOLE).directions is None


def test_strong_barrel_is_inverted_up_to_its_fold() -> None:
    # r (1 - r^2 / 4) grows up to r = sqrt(4 / 3), where it is 0.7698
    camera = CameraModel(
        300, 10, 200.0, 200.0, 150.0, 5.0, False, "plumb_bob", (-0.25, 0.0, 0.0, 0.0, 0.0)
    )
    directions, _ = rays(camera, np.array([150 + 200 * 0.7697]), np.array([5.0]))
    r = directions[0, 0]
    assert r < np.sqrt(4 / 3)
    assert r - r**3 / 4 == pytest.approx(0.7697, abs=1e-12)
    # 150 / 200 = 0.75: the corners of a picture 300 px wide are just inside, of one 320 px wide not
    make_lens(camera)
    with pytest.raises(EvsError, match=r"pixel \(0, 0\).*folds over 49\.1 degrees.*equidistant"):
        make_lens(replace(camera, width=320, cx=160.0))


def test_a_pole_is_no_image() -> None:
    camera = replace(
        PINHOLE,
        distortion_model="rational_polynomial",
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0, -9.0, 0.0, 0.0),
    )
    # the denominator is 0 at r = 1/3: rays come up to it, and every pixel has one before it
    found, _ = rays(camera, np.array([0.0, 346.0]), np.array([0.0, 260.0]))
    assert (np.hypot(found[:, 0], found[:, 1]) < 1 / 3).all()
    behind = np.array([[0.4, 0.0, -1.0], [0.2, 0.0, -1.0]])
    image = project(camera, behind)
    assert np.isnan(image[0]).all()
    assert np.isfinite(image[1]).all()


BAD = {
    "count": (
        {"distortion_model": "plumb_bob", "distortion": (0.1,)},
        "1 coefficients.*takes 5: k1",
    ),
    "no model": ({"distortion": (0.1,) * 5}, "none takes none: give the model's name"),
    "unknown": ({"distortion_model": "plumbob"}, "plumb_bob"),
    "nan": (
        {"distortion_model": "equidistant", "distortion": (0, 0, float("nan"), 0)},
        "k3 is nan; give a number from a calibration",
    ),
    "flat": (
        {"distortion_model": "equidistant", "distortion": (0.0,) * 4, "orthographic": True},
        "orthographic",
    ),
    "fold": (
        {"distortion_model": "plumb_bob", "distortion": (-2.0, 0, 0, 0, 0)},
        r"pixel \(0, 0\).*folds over",
    ),
    "tangential": (
        {"distortion_model": "plumb_bob", "distortion": (0, 0, 1.5, 0, 0)},
        r"no ray leads to pixel \(\d+, 0\), p1 and p2 fold the image over",
    ),
    "huge": (
        {"distortion_model": "plumb_bob", "distortion": (-1e7, 0, 0, 0, 0)},
        r"k1 is -10000000.0; give",
    ),
    "two branches": (
        {
            "distortion_model": "plumb_bob",
            "distortion": (0.1034126, -0.1526053, 0.1853375, 0.0902224, 0.0888382),
            "width": 23,
            "height": 17,
            "fx": 12.4210579,
            "fy": 13.6103896,
            "cx": 14.5663913,
            "cy": 17.3900939,
        },
        "bends the image too much within pixel",
    ),
    "coarse": (
        {"distortion_model": "equidistant", "distortion": (0.0,) * 4, "fx": 0.5, "fy": 0.5},
        "over 60 degrees",
    ),
    "no circle": (
        {"distortion_model": "equidistant", "distortion": (0.0,) * 4, "cx": -2e4},
        "image circle",
    ),
}


@pytest.mark.parametrize(("change", "says"), BAD.values(), ids=BAD)
def test_bad_coefficients_are_one_line(change: dict, says: str) -> None:
    with pytest.raises(EvsError, match=says) as error:
        make_lens(replace(PINHOLE, **change))
    assert "\n" not in str(error.value)


def test_every_model_has_its_coefficients_named() -> None:
    assert {name: len(words.split()) for name, words in MODELS.items()} == {
        "none": 0,
        "plumb_bob": 5,
        "rational_polynomial": 8,
        "equidistant": 4,
    }
