"""Compute tilt and place of the stick from its lines in two cameras at right angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.examples.pencil.line_tracker import F64, StickLine

FOCAL_PX = 590.0
"""focal length of both cameras (config/scenes/pencil.xml)"""

DISTANCE_M = 1.2
"""from each camera to the middle of the cart's range"""


@dataclass(frozen=True)
class Stick:
    """The stick as seen by both cameras."""

    tilt: F64
    """(2,) angles from upright in the planes x z and y z, rad; positive is towards +x, +y"""
    place: F64
    """(2,) x and y of its tip, m"""


def combine(left: StickLine, right: StickLine) -> Stick:
    """The stick from its lines in both images.

    Left looks along +y: a point (x + p z, y + q z, z) is seen at u = f (x + p z) / (D + y + q z),
    v = f z / (D + y + q z). Along the stick that is a line of slope p - (x / (D + y)) q from base
    f x / (D + y). Right looks along -x: slope q + (y / (D - x)) p, base f y / (D - x).
    """
    bx, by = left.base / FOCAL_PX, right.base / FOCAL_PX
    mixed = 1.0 + bx * by
    slope_x = (left.slope + bx * right.slope) / mixed
    slope_y = (right.slope - by * left.slope) / mixed
    x = bx * DISTANCE_M * (1.0 + by) / mixed
    y = by * (DISTANCE_M - x)
    return Stick(np.arctan([slope_x, slope_y]), np.array([x, y]))


def project(place: F64) -> tuple[float, float]:
    """Project a tip at place (2,), m, into the left and the right image: px from the middle."""
    x, y = float(place[0]), float(place[1])
    return FOCAL_PX * x / (DISTANCE_M + y), FOCAL_PX * y / (DISTANCE_M - x)


def stick_line(stick: Stick, camera: int) -> StickLine:
    """The line of a stick in the left (0) or the right (1) image, the inverse of `combine`."""
    base = project(stick.place)[camera]
    along, across = np.tan(stick.tilt)
    if camera == 0:
        return StickLine(base, float(along - base / FOCAL_PX * across))
    return StickLine(base, float(across + base / FOCAL_PX * along))
