"""A camera's lens as the tracer takes it: tables that know no model, with its vignetting.

The tracer interpolates the corners' directions inside a pixel. Against the exact inversion that is
off by at most 0.004 px, measured at 346 x 260 (test_optics_models.py): 0.0008 px with 85
degrees of plumb_bob, 0.004 with 149 of rational_polynomial, 0.002 with 200 of a fisheye, which
grows to 0.01 at 300; 360 degrees end in a point, and 0.4 px at its rim. The error in pixels is
inversely proportional to the resolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, F64, CameraModel
from evs.emulator.optics.distortion import (
    Brown,
    Equidistant,
    check_distortion,
    is_distorted,
    project,
)
from evs.msgs import EvsError, unknown

MOST_OFF_PX = 0.5
"""Error of an interpolated centre that only a broken map has."""


@dataclass(frozen=True)
class Lens:
    """What lies between the world and the pixels; None is a pinhole's."""

    directions: F32 | None = None
    """(h + 1, w + 1, 3) ray at each pixel's corners, camera's frame, any length"""
    share: F32 | None = None
    """(h, w) factor of the light that reaches a pixel; 0 outside the image circle"""
    outside: npt.NDArray[np.bool_] | None = None
    """(h, w) pixels that reach over the rim of a fisheye's image circle"""


def make_lens(camera: CameraModel) -> Lens:
    """The tables of a camera. EvsError where its coefficients give a pixel no ray."""
    check_distortion(camera)
    check_vignetting(camera)
    shaded = camera.vignetting != "none" or bool(camera.vignetting_polynomial)
    bent = is_distorted(camera)
    if not (bent or shaded):
        return Lens()
    x, y = np.meshgrid(np.arange(camera.width + 1.0), np.arange(camera.height + 1.0))
    directions, beyond = rays(camera, x, y)
    quads = (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[:-1, 1:], np.s_[1:, 1:])
    outside: npt.NDArray[np.bool_] = np.logical_or.reduce([beyond[quad] for quad in quads])
    if outside.all():
        raise EvsError(
            "camera.distortion: no pixel lies in the lens's image circle; check camera.focal_px, "
            "principal_px and the coefficients"
        )
    centres = sum((directions[quad] for quad in quads), np.zeros(3))
    # a fisheye has one branch, and at the rim of 360 degrees everything runs together
    if bent and camera.distortion_model != "equidistant":
        _check_centres(camera, centres, outside)
    share = light_share(camera, centres)
    share[outside] = 0.0
    return Lens(
        directions=directions.astype(np.float32) if bent else None,
        share=share.astype(np.float32) if shaded or outside.any() else None,
        outside=outside if outside.any() else None,
    )


def rays(camera: CameraModel, x: F64, y: F64) -> tuple[F64, npt.NDArray[np.bool_]]:
    """Directions (..., 3) through image points (px) and whether they lie outside the image circle.

    EvsError with the first pixel that the model cannot have.
    """
    u, v = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy
    if camera.distortion_model == "equidistant":
        directions, outside = Equidistant(camera.distortion).undo(u, v)
        _check_steps(camera, directions)
        return directions, outside
    if is_distorted(camera):
        lens = Brown(camera.distortion)
        u, v = lens.undo(u, v)
        if not np.isfinite(u).all():
            column, row = (
                min(int(part[~np.isfinite(u)][0]), size - 1)
                for part, size in ((x, camera.width), (y, camera.height))
            )
            last = np.degrees(np.arctan(lens.last_radius))
            fold = f"the image folds over {last:.1f} degrees off the axis"
            if not np.isfinite(lens.last_radius):
                fold = "p1 and p2 fold the image over"
            raise EvsError(
                f"camera.distortion: no ray leads to pixel ({column}, {row}), {fold}: "
                "give a longer camera.focal_px, other "
                'coefficients, or distortion_model = "equidistant" for a wide lens'
            )
    directions = np.stack([u, -v, -np.ones_like(u)], -1)
    return directions, np.zeros(u.shape, np.bool_)


def _check_centres(camera: CameraModel, centres: F64, outside: npt.NDArray[np.bool_]) -> None:
    """EvsError where what lies between four corners is not the pixel.

    Then they came from two branches of the map, or it bends too much.

    Args:
        camera: The camera.
        centres: (h, w, 3) interpolated directions of the pixels' centres.
        outside: (h, w) pixels that are not checked.
    """
    image = project(camera, centres.reshape(-1, 3)).reshape(*outside.shape, 2)
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    off = np.hypot(image[..., 0] - x, image[..., 1] - y)
    wrong = ~outside & ~(off < MOST_OFF_PX)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise EvsError(
            f"camera.distortion bends the image too much within pixel ({column}, {row}): give a "
            "longer camera.focal_px, or other coefficients"
        )


def _check_steps(camera: CameraModel, directions: F64) -> None:
    """EvsError where neighbours are so far apart that what lies between them means nothing."""
    for axis in range(directions.ndim - 1):
        a, b = np.delete(directions, -1, axis), np.delete(directions, 0, axis)
        if ((a * b).sum(-1) < 0.5).any():
            raise EvsError(
                f"camera.focal_px ({camera.fx:g}, {camera.fy:g}): one pixel of this fisheye sees "
                "over 60 degrees; give a longer focal length"
            )


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
