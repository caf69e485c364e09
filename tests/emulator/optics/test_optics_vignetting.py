"""Vignetting: the cos^4 law and the radial polynomial, in a room that glows evenly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base.scene import CameraModel
from evs.emulator.config import CameraConfig
from evs.emulator.optics import make_lens
from evs.msgs import EvsError
from reference.instants import Film

WIDTH, HEIGHT = 61, 45
CAMERA = CameraModel(WIDTH, HEIGHT, 40.0, 42.0, 29.0, 24.0)

ROOM = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset>
    <material name="glow" emission="1" specular="0" rgba="1 1 1 1"/>
  </asset>
  <worldbody>
    <geom type="plane" size="0 0 1" pos="0 0 -1" material="glow"/>
    <geom type="plane" size="0 0 1" pos="0 0 1" euler="180 0 0" material="glow"/>
    <geom type="plane" size="0 0 1" pos="2 0 0" euler="0 -90 0" material="glow"/>
    <geom type="plane" size="0 0 1" pos="-2 0 0" euler="0 90 0" material="glow"/>
    <geom type="plane" size="0 0 1" pos="0 2 0" euler="90 0 0" material="glow"/>
    <geom type="plane" size="0 0 1" pos="0 -2 0" euler="-90 0 0" material="glow"/>
    <body name="eye"/>
  </worldbody>
</mujoco>
"""


def room_light(rgb: bool = False, **optics: object):
    """(renderer, snapshot, luminance) in the middle of a room that glows evenly."""
    view = CameraConfig(
        body="eye", focal_px=(40.0, 42.0), principal_px=(29.0, 24.0), xyaxes=(0, -1, 0, 0, 0, 1)
    )
    film = Film(ROOM, (WIDTH, HEIGHT), replace(view, **optics))
    renderer = film.renderer(2, rgb=rgb, spp=2)
    return renderer, film.shot, renderer.render(film.shot, film.shot.cameras[0])


def test_the_room_is_even() -> None:
    _, _, light = room_light()
    np.testing.assert_allclose(light, 1.0, rtol=1e-6)


def test_cos4_is_the_cosine_to_the_fourth() -> None:
    _, _, light = room_light(vignetting="cos4")
    x = (np.arange(WIDTH) + 0.5 - 29) / 40
    y = (np.arange(HEIGHT)[:, np.newaxis] + 0.5 - 24) / 42
    np.testing.assert_allclose(light, 1 / (1 + x * x + y * y) ** 2, rtol=1e-6)


def test_cos4_of_a_fisheye_goes_by_its_own_angles() -> None:
    fisheye = {
        "distortion_model": "equidistant",
        "distortion": (0.0,) * 4,
        "focal_px": (16.0, 16.0),
    }
    _, _, light = room_light(vignetting="cos4", **fisheye)
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 - 29, np.arange(HEIGHT) + 0.5 - 24)
    angle = np.hypot(x, y) / 16
    expected = np.where(angle < np.pi / 2, np.cos(angle), 0.0) ** 4
    # the angle of a pixel's centre is interpolated, see lens.py
    np.testing.assert_allclose(light, expected, atol=1e-3)
    assert (light[angle > np.pi / 2 + 0.02] == 0).all()
    assert (angle > np.pi / 2 + 0.02).any()


def test_the_polynomial_is_one_in_half_diagonals() -> None:
    _, _, light = room_light(vignetting_polynomial=(-0.3, 0.1, -0.05))
    x = np.arange(WIDTH) + 0.5 - 29
    y = np.arange(HEIGHT)[:, np.newaxis] + 0.5 - 24
    s = (x * x + y * y) / ((WIDTH / 2) ** 2 + (HEIGHT / 2) ** 2)
    np.testing.assert_allclose(light, 1 - 0.3 * s + 0.1 * s**2 - 0.05 * s**3, rtol=1e-6)


def test_both_multiply() -> None:
    (_, _, a), (_, _, b), (_, _, both) = (
        room_light(vignetting=law, vignetting_polynomial=polynomial)
        for law, polynomial in (("cos4", ()), ("none", (-0.4,)), ("cos4", (-0.4,)))
    )
    np.testing.assert_allclose(both, a.astype(np.float64) * b, rtol=1e-6)


@pytest.mark.parametrize("model", ["none", "equidistant"])
def test_single_pixels_and_colours_are_shaded_alike(model: str) -> None:
    lens = {"distortion_model": model, "distortion": (0.0,) * 4 if model == "equidistant" else ()}
    renderer, snapshot, light = room_light(True, vignetting="cos4", **lens)
    every = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    alone = renderer.trace(snapshot, snapshot.cameras[0], every)
    np.testing.assert_array_equal(alone.reshape(HEIGHT, WIDTH), light)
    np.testing.assert_allclose(renderer.rgb, np.stack([light] * 3, -1), rtol=1e-6)


BAD = {
    "law": ({"vignetting": "cos5"}, "cos4"),
    "negative": ({"vignetting_polynomial": (-2.0,)}, r"pixel \(0, 0\) -.* times the light"),
    "infinite": ({"vignetting_polynomial": (float("inf"),)}, "finite numbers"),
    "overflow": ({"vignetting_polynomial": (1e308, 1e308)}, "times the light"),
    "flat": ({"vignetting": "cos4", "orthographic": True}, "vignetting_polynomial instead"),
}


@pytest.mark.parametrize(("change", "says"), BAD.values(), ids=BAD)
def test_bad_values_are_one_line(change: dict, says: str) -> None:
    with pytest.raises(EvsError, match=says) as error:
        make_lens(replace(CAMERA, **change))
    assert "\n" not in str(error.value)


def test_an_orthographic_camera_may_have_a_polynomial() -> None:
    lens = make_lens(replace(CAMERA, orthographic=True, vignetting_polynomial=(-0.1,)))
    assert lens.directions is None
    assert lens.share is not None
    assert lens.share.min() < 0.95


@pytest.mark.slow
def test_the_raster_renderer_is_shaded_too() -> None:
    lights = []
    for law in ("none", "cos4"):
        view = CameraConfig(body="eye", fovy=60, xyaxes=(0, -1, 0, 0, 0, 1), vignetting=law)
        film = Film(ROOM, (WIDTH, HEIGHT), view)
        lights.append(film.light(renderer="raster"))
    share = make_lens(film.camera).share
    assert lights[0].min() > 0.5
    np.testing.assert_allclose(lights[1], lights[0] * share, rtol=1e-6)
