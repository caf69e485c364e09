"""Which lens model a camera has, whether its coefficients make sense, and where points appear."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import F64, CameraModel
from evs.emulator.optics.brown import Brown
from evs.emulator.optics.equidistant import Equidistant
from evs.msgs import EvsError, unknown

MODELS = {
    "none": "",
    "plumb_bob": "k1 k2 p1 p2 k3",
    "rational_polynomial": "k1 k2 p1 p2 k3 k4 k5 k6",
    "equidistant": "k1 k2 k3 k4",
}
"""distortion model, by the names of ROS's CameraInfo -> its coefficients, in OpenCV's order"""

LARGEST = 1e6
"""Coefficients of real lenses are below 100; up to here nothing overflows."""


def check_distortion(camera: CameraModel) -> None:
    """EvsError for an unknown model, coefficients that it does not have, and flat cameras."""
    model, given = camera.distortion_model, camera.distortion
    if model not in MODELS:
        raise unknown("camera.distortion_model", model, MODELS)
    names = MODELS[model].split()
    if len(given) != len(names):
        wants = f"{len(names)}: {MODELS[model]}" if names else "none: give the model's name too"
        raise EvsError(
            f"camera.distortion has {len(given)} coefficients, and {model} takes {wants}"
        )
    for name, value in zip(names, given, strict=True):
        if not abs(value) <= LARGEST:
            raise EvsError(
                f"camera.distortion: {name} is {value}; give a number from a calibration, "
                f"{-LARGEST:g} ... {LARGEST:g}"
            )
    if names and camera.orthographic:
        raise EvsError(
            "camera.distortion_model is for lenses, and this camera is orthographic: "
            'give distortion_model = "none", or a perspective camera'
        )


def is_distorted(camera: CameraModel) -> bool:
    """Whether rays are any different from a pinhole's: all-zero coefficients are none at all."""
    return camera.distortion_model == "equidistant" or any(camera.distortion)


def project(camera: CameraModel, points: F64) -> F64:
    """(n, 2) px of points (n, 3) in the camera's frame; NaN for what has no image."""
    x, y, z = points.T
    if camera.distortion_model == "equidistant":
        u, v = Equidistant(camera.distortion).image(points)
    else:
        depth = np.ones_like(z) if camera.orthographic else np.where(z < 0.0, -z, np.nan)
        u, v = x / depth, -y / depth
        if is_distorted(camera):
            u, v = Brown(camera.distortion).image(u, v)
    return np.stack([camera.cx + camera.fx * u, camera.cy + camera.fy * v], 1)
