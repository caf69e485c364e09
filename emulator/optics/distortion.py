"""Lens distortion: the models, whether coefficients make sense, and where points appear.

The models are OpenCV's: Brown's (plumb_bob, rational_polynomial) and the fisheye (equidistant).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import polynomial

from evs.emulator.base.scene import F64, CameraModel
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


FLATTEST = 1e4
"""Largest radius that is looked for: 89.99 degrees off the axis."""
STEPS = 40
SAMPLES = 4097


@dataclass(frozen=True)
class Brown:
    """Brown's lens model as OpenCV has it: coefficients k1 k2 p1 p2 k3 [k4 k5 k6].

    plumb_bob has 5, rational_polynomial 8. With x, y the pinhole's image point (to the right and
    down, focal length 1) and s = x^2 + y^2:

        R  = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)
        xd = x R + 2 p1 x y + p2 (s + 2 x^2)        yd = y R + p1 (s + 2 y^2) + 2 p2 x y
    """

    coefficients: tuple[float, ...]

    def image(self, x: F64, y: F64) -> tuple[F64, F64]:
        """Pinhole point to distorted point; NaN past the last radius."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            s = x * x + y * y
            ratio = self._ratio(s)[0]
            inside = s < self.last_radius**2
            xd, yd = self._bent(x, y, s, ratio)
        return np.where(inside, xd, np.nan), np.where(inside, yd, np.nan)

    @property
    def last_radius(self) -> float:
        """Up to here r R grows with r; from there on the image folds over itself."""
        numerator, denominator = self._polynomials()
        rise = polynomial.polymul(derivative(numerator), denominator)
        fall = polynomial.polymul(numerator, derivative(denominator))
        # d(r R)/dr is R + 2 s dR/ds; the square of the denominator does not matter
        slope: F64 = polynomial.polyadd(
            polynomial.polymul(numerator, denominator),
            2.0 * polynomial.polymulx(polynomial.polysub(rise, fall)),
        ).astype(np.float64)
        return math.sqrt(min(first_root(slope), first_root(denominator)))

    def undo(self, xd: F64, yd: F64) -> tuple[F64, F64]:
        """Distorted point to pinhole point; NaN where there is none before the fold.

        By Newton's method, from where the radial part alone would have it.
        """
        reach, wanted = self.last_radius, np.hypot(xd, yd)
        with np.errstate(all="ignore"):
            start = self._start(wanted, reach) / np.maximum(wanted, 1e-300)
            start = np.where(wanted > 0.0, start, 1.0)
            x, y = xd * start, yd * start
            for _ in range(STEPS):
                s = x * x + y * y
                ratio, slope = self._ratio(s)
                at_x, at_y = self._bent(x, y, s, ratio)
                off_x, off_y = xd - at_x, yd - at_y
                (xx, xy, yy), determinant = self._jacobian(x, y, ratio, slope)
                step_x = (yy * off_x - xy * off_y) / determinant
                step_y = (xx * off_y - xy * off_x) / determinant
                # far from the solution a step may be wild
                most = 0.2 * (1.0 + np.sqrt(s))
                share = np.minimum(1.0, most / np.maximum(np.hypot(step_x, step_y), 1e-300))
                x, y = x + step_x * share, y + step_y * share
                if np.all(np.hypot(step_x, step_y) <= 1e-15 * (1.0 + np.sqrt(s))):
                    break
            s = x * x + y * y
            ratio, slope = self._ratio(s)
            at_x, at_y = self._bent(x, y, s, ratio)
            close = np.hypot(xd - at_x, yd - at_y) <= 1e-11 * (1.0 + wanted)
            found = close & (s < reach**2) & (self._jacobian(x, y, ratio, slope)[1] > 0.0)
        return np.where(found, x, np.nan), np.where(found, y, np.nan)

    def _polynomials(self) -> tuple[F64, F64]:
        """Numerator and denominator of R, in powers of s."""
        k1, k2, _, _, k3, *rest = self.coefficients
        return np.array([1.0, k1, k2, k3]), np.array([1.0, *rest])

    def _ratio(self, s: F64) -> tuple[F64, F64]:
        """R and dR/ds."""
        numerator, denominator = self._polynomials()
        above, rise = value(numerator, s), value(derivative(numerator), s)
        if len(denominator) == 1:
            return above, rise
        below, fall = value(denominator, s), value(derivative(denominator), s)
        return above / below, (rise * below - above * fall) / (below * below)

    def _bent(self, x: F64, y: F64, s: F64, ratio: F64) -> tuple[F64, F64]:
        _, _, p1, p2, *_ = self.coefficients
        product = 2.0 * x * y
        return (
            x * ratio + p1 * product + p2 * (s + 2.0 * x * x),
            y * ratio + p1 * (s + 2.0 * y * y) + p2 * product,
        )

    def _jacobian(self, x: F64, y: F64, ratio: F64, slope: F64) -> tuple[tuple[F64, F64, F64], F64]:
        """d(xd)/dx, d(xd)/dy = d(yd)/dx, d(yd)/dy, and the determinant."""
        _, _, p1, p2, *_ = self.coefficients
        xx = ratio + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        yy = ratio + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        return (xx, xy, yy), xx * yy - xy * xy

    def _start(self, wanted: F64, reach: float) -> F64:
        """Radius of the pinhole point by the radial part alone, roughly; `reach` where none is."""
        most, end = float(wanted.max(initial=0.0)), 1.0
        while end < min(reach, FLATTEST) and end * float(self._ratio(np.array(end**2))[0]) < most:
            end *= 2.0
        r = np.linspace(0.0, min(end, reach, FLATTEST) * (1.0 - 1e-9), SAMPLES)
        start: F64 = np.interp(wanted, r * self._ratio(r * r)[0], r).astype(np.float64)
        return start


def value(coefficients: F64, x: F64) -> F64:
    """A polynomial in rising powers at `x`, by Horner's rule."""
    return np.asarray(polynomial.polyval(x, coefficients), np.float64)


def derivative(coefficients: F64) -> F64:
    """Of a polynomial in rising powers."""
    return np.asarray(polynomial.polyder(coefficients), np.float64)


def first_root(coefficients: F64) -> float:
    """Smallest positive real root of a polynomial in rising powers; inf where it has none."""
    roots = np.asarray(
        polynomial.polyroots(polynomial.polytrim(coefficients, 1e-30)), np.complex128
    )
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return float(real.min(initial=math.inf))


@dataclass(frozen=True)
class Equidistant:
    """The fisheye lens of Kannala and Brandt as OpenCV has it: coefficients k1 k2 k3 k4.

    With theta the angle off the axis, the image point lies towards the point seen, at the radius
    (focal length 1) theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).
    """

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
