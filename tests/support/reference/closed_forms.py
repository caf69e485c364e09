"""Light that can be written down: sRGB, form factors, and what a GGX surface reflects."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def linear(coded: npt.ArrayLike) -> F64:
    """Convert sRGB codes of 0 ... 1 to linear light (IEC 61966-2-1)."""
    c = np.asarray(coded, np.float64)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def of_rectangle(x: F64, y: F64, half: tuple[float, float], height: float) -> F64:
    """Form factor from points (x, y, 0) facing up to a rectangle around (0, 0, height).

    It is a signed sum over the corners (Howell, "Radiation configuration factors", C-3).
    """

    def corner(a: F64, b: F64) -> F64:
        a, b = a / height, b / height
        p, q = np.hypot(1, a), np.hypot(1, b)
        return np.asarray((a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi))

    left, right, low, high = -half[0] - x, half[0] - x, -half[1] - y, half[1] - y
    return corner(right, high) - corner(left, high) - corner(right, low) + corner(left, low)


def of_sphere(x: F64, y: F64, radius: float, height: float) -> F64:
    """Form factor from points (x, y, 0) facing up to a sphere around (0, 0, height).

    All of the sphere must be above the points.
    """
    square = x**2 + y**2 + height**2
    return np.asarray(radius**2 / square * height / np.sqrt(square))


def of_wall(distance: F64, height: float) -> F64:
    """Form factor from points on a floor to an endless upright wall."""
    return np.asarray((1 - distance / np.hypot(distance, height)) / 2)


def ggx(a: F64, b: F64, alpha: float) -> F64:
    """The BRDF f(a, b) of GGX around z, per sr, for a reflectance of 1.

    Each direction is shadowed independently of the other (Walter et al. 2007).

    Args:
        a: Unit vectors (..., 3) above the surface.
        b: Unit vectors (..., 3) above the surface.
        alpha: The roughness of GGX.
    """
    half = a + b
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    square = alpha**2
    facets = square / (np.pi * (half[..., 2] ** 2 * (square - 1) + 1) ** 2)

    def seen(w: F64) -> F64:
        slope = (1 - w[..., 2] ** 2) / w[..., 2] ** 2
        return np.asarray(2 / (1 + np.sqrt(1 + square * slope)))

    return np.asarray(facets * seen(a) * seen(b) / (4 * a[..., 2] * b[..., 2]))


def ggx_density(eye: F64, w: F64, alpha: float) -> F64:
    """Density per sr of w as the mirror image of `eye` in the facets that it sees (Heitz 2018)."""
    half = w + eye
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    square = alpha**2
    facets = square / (np.pi * (half[..., 2] ** 2 * (square - 1) + 1) ** 2)
    slope = (1 - eye[2] ** 2) / eye[2] ** 2
    seen = 2 / (1 + np.sqrt(1 + square * slope))
    return np.asarray(facets * seen / (4 * eye[2]))


def ggx_albedo(cosine: float, alpha: float, nodes: int = 400) -> float:
    """The share of light from all sides that GGX of reflectance 1 reflects into one direction."""
    eye = np.array([np.sqrt(1 - cosine**2), 0, cosine])
    # integrate over facets: their density contains the peak, so that the rest is smooth
    x, w = np.polynomial.legendre.leggauss(nodes)
    share, angle = (x + 1) / 2, (x + 1) * np.pi
    tangent = alpha * np.sqrt(share / (1 - share))
    z = 1 / np.sqrt(1 + tangent**2)
    s = tangent * z
    facet = np.stack(
        [
            s[:, None] * np.cos(angle),
            s[:, None] * np.sin(angle),
            np.broadcast_to(z[:, None], (nodes, nodes)),
        ],
        -1,
    )
    toward = facet @ eye
    light = 2 * toward[..., None] * facet - eye
    above = (toward > 0) & (light[..., 2] > 0)
    light = np.where(above[..., None], light, [0.0, 0.0, 1.0])
    # f cos dw = f cos 4 (eye facet) dm, and facets are drawn with the density D (m z)
    square = alpha**2
    density = square / (np.pi * (facet[..., 2] ** 2 * (square - 1) + 1) ** 2) * facet[..., 2]
    value = ggx(np.broadcast_to(eye, light.shape), light, alpha) * light[..., 2] * 4 * toward
    value = np.where(above, value / density, 0.0)
    return float(np.einsum("ij,i,j->", value, w / 2, w / 2))
