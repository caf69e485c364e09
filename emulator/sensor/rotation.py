"""From two orientations to the rotation between them, by correctly rounded operations only."""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector3 = tuple[float, float, float]


def rotation_vector(before: Sequence[float], after: Sequence[float]) -> Vector3:
    """Find the turn from one orientation to another: the shorter way, at most half a turn.

    Args:
        before: (9,) row-major matrix, frame to world.
        after: As `before`.

    Returns:
        Axis times angle, rad, in the turning frame.
    """
    # element (i, j) of before^T after
    relative = [[dot(before[i::3], after[j::3]) for j in range(3)] for i in range(3)]
    w, x, y, z = _quaternion(relative)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    # a quarter of the angle has the tangent sine / (w + 1)
    angle = 4.0 * _arctangent(sine / (w + math.sqrt(w * w + sine * sine)))
    return angle * (x / sine), angle * (y / sine), angle * (z / sine)


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Scalar product of two vectors of three, summed in their order."""
    # Python's sum() rounds in another way since 3.12
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _quaternion(m: Sequence[Sequence[float]]) -> tuple[float, float, float, float]:
    """w >= 0, x, y, z of a rotation matrix; by its largest part (Shepperd 1978)."""
    diagonal = m[0][0], m[1][1], m[2][2]
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace >= max(diagonal):
        w = 0.5 * math.sqrt(max(0.0, 1.0 + trace))
        f = 0.25 / w
        return w, f * (m[2][1] - m[1][2]), f * (m[0][2] - m[2][0]), f * (m[1][0] - m[0][1])
    i = diagonal.index(max(diagonal))
    j, k = (i + 1) % 3, (i + 2) % 3
    largest = 0.5 * math.sqrt(max(0.0, 1.0 + m[i][i] - m[j][j] - m[k][k]))
    f = 0.25 / largest
    parts = [0.0, 0.0, 0.0]
    parts[i], parts[j], parts[k] = largest, f * (m[j][i] + m[i][j]), f * (m[k][i] + m[i][k])
    w = f * (m[k][j] - m[j][k])
    sign = -1.0 if w < 0.0 else 1.0
    return sign * w, sign * parts[0], sign * parts[1], sign * parts[2]


def _arctangent(value: float) -> float:
    """Of 0 ... 1, error below 1e-16: halved twice, then the Taylor series."""
    for _ in range(2):
        value = value / (1.0 + math.sqrt(1.0 + value * value))
    square = value * value  # at most 0.04
    series = 0.0
    for odd in range(23, 0, -2):
        series = 1.0 / odd - square * series
    return 4.0 * value * series
