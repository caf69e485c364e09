"""Vignetting: how much of the light each pixel gets."""

from __future__ import annotations

import math

import numpy as np

from evs.emulator.base.scene import F64, CameraModel
from evs.msgs import EvsError, unknown

VIGNETTINGS = ("none", "cos4")


def check_vignetting(camera: CameraModel) -> None:
    """EvsError for an unknown law, a factor below 0, and cos4 without an angle."""
    if camera.vignetting not in VIGNETTINGS:
        raise unknown("camera.vignetting", camera.vignetting, VIGNETTINGS)
    if camera.vignetting == "cos4" and camera.orthographic:
        raise EvsError(
            "camera.vignetting is cos4, and every ray of an orthographic camera is parallel to "
            "the axis: give camera.vignetting_polynomial instead"
        )
    if not all(map(math.isfinite, camera.vignetting_polynomial)):
        raise EvsError(
            f"camera.vignetting_polynomial is {camera.vignetting_polynomial}; give finite numbers"
        )


def light_share(camera: CameraModel, directions: F64) -> F64:
    """(h, w) factor of each pixel, from the direction through its centre.

    The natural law is cos^4 of the angle off the axis, 0 from 90 degrees on. The polynomial is
    1 + a r^2 + b r^4 + ..., r from the principal point in half diagonals of the image. In:
    directions (h, w, 3) in the camera's frame, any length. EvsError where a factor is negative.
    """
    share = np.ones(directions.shape[:2])
    if camera.vignetting == "cos4":
        x, y, z = np.moveaxis(directions, -1, 0)
        squared = np.where(z < 0.0, z * z / (x * x + y * y + z * z), 0.0)
        share = squared * squared
    if not camera.vignetting_polynomial:
        return share
    x = (np.arange(camera.width) + 0.5 - camera.cx) ** 2
    y = (np.arange(camera.height) + 0.5 - camera.cy) ** 2
    square = (x + y[:, np.newaxis]) / ((camera.width**2 + camera.height**2) / 4)
    factor = np.zeros_like(square)
    with np.errstate(over="ignore", invalid="ignore"):
        for coefficient in (*reversed(camera.vignetting_polynomial), 1.0):
            factor = factor * square + coefficient
    wrong = ~(np.isfinite(factor) & (factor >= 0.0))
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise EvsError(
            f"camera.vignetting_polynomial gives pixel ({column}, {row}) {factor[row, column]:.3g} "
            "times the light; it must be 0 or more everywhere (r is 1 half a diagonal off the "
            "principal point)"
        )
    return share * factor
