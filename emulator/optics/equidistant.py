"""The fisheye lens of Kannala and Brandt as OpenCV has it; ROS calls it equidistant.

With theta the angle off the axis, the image point lies towards the point seen, at the radius
(focal length 1) theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64
from evs.emulator.optics.brown import SAMPLES, STEPS, first_root, value


@dataclass(frozen=True)
class Equidistant:
    """The model with coefficients k1 k2 k3 k4."""

    coefficients: tuple[float, ...]

    @property
    def last_angle(self) -> float:
        """rad: where the radius stops growing, at most pi. The rim of the image circle."""
        return min(math.pi, math.sqrt(first_root(self._slope)))

    def radius(self, angle: F64) -> F64:
        """Image radius of an angle off the axis."""
        return angle * value(np.array([1.0, *self.coefficients]), angle * angle)

    def image(self, points: F64) -> tuple[F64, F64]:
        """Image of points (n, 3) in the camera's frame; NaN past the last angle."""
        x, y, z = points.T
        across = np.hypot(x, y)
        angle = np.arctan2(across, -z)
        radius = np.where(angle <= self.last_angle, self.radius(angle), np.nan)
        share = radius / np.where(across > 0.0, across, 1.0)
        return x * share, -y * share

    def undo(self, xd: F64, yd: F64) -> tuple[F64, npt.NDArray[np.bool_]]:
        """(..., 3) unit directions of image points, and (...) bool whether they lie outside.

        Outside the image circle the direction is that of its rim.
        """
        last, wanted = self.last_angle, np.hypot(xd, yd)
        rim = float(self.radius(np.array(last)))
        target = np.minimum(wanted, rim)
        samples = np.linspace(0.0, last, SAMPLES)
        angle = np.interp(target, self.radius(samples), samples)
        for _ in range(STEPS):
            rise = np.maximum(value(self._slope, angle * angle), 1e-9)
            step = (target - self.radius(angle)) / rise
            angle = np.clip(angle + step, 0.0, last)
            if np.all(np.abs(step) <= 1e-14):
                break
        share = np.sin(angle) / np.where(wanted > 1e-12, wanted, 1.0)
        share = np.where(wanted > 1e-12, share, 1.0)
        return np.stack([xd * share, -yd * share, -np.cos(angle)], -1), wanted > rim

    @property
    def _slope(self) -> F64:
        """d(radius)/d(angle) in powers of the angle's square."""
        return np.array([1.0, *(k * (2 * n + 3) for n, k in enumerate(self.coefficients))])
