"""Curves that tendons follow: arcs, strings that hang, and frames along them.

In elementary operations and Python's math alone, so that every machine finds the same bits.
"""

from __future__ import annotations

import math
from itertools import chain, pairwise

import numpy as np

from evs.emulator.base.scene import F64

HALVINGS = 4
"""A stretch that lies on a sphere or cylinder is halved so often: at a right angle its pieces run
0.12 % of the radius inside. MuJoCo 4 draws such an arc, its older versions a thinner chord."""

VERTICAL = 100.0
"""A string this much longer than its ends are apart sideways hangs like one with a bead on it."""


def catenary(start: F64, end: F64, gravity: F64, length: float, pieces: int) -> F64:
    """(pieces + 1, 3) points along a string of that length, m, that hangs between two points.

    Straight where it is too short to hang, or nothing pulls it down. At horizontal distances of
    i / (pieces + 1), where MuJoCo has them.
    """
    shares = np.arange(pieces + 1)[:, None] / pieces
    pull = math.sqrt(dot(gravity, gravity))
    span = end - start
    if pull < 1e-15 or dot(span, span) >= length * length:
        return start + shares * span
    up = gravity / -pull
    rise = float(dot(span, up))
    across = span - rise * up
    width = math.sqrt(dot(across, across))
    if length > VERTICAL * width:
        # as deep as a bead slides that hangs on it
        depth = 0.5 * (math.sqrt(length * length - width * width) - rise)
        lowest = start - depth * up + across * (depth / max(2.0 * depth + rise, 1e-30))
        half = (pieces + 1) // 2
        down = np.arange(half + 1)[:, None] / half
        rest = np.arange(1, pieces - half + 1)[:, None] / max(pieces - half, 1)
        return np.vstack([start + down * (lowest - start), lowest + rest * (end - lowest)])
    # sinh(x) / x = slack, x the width in half scales: Newton's steps from above fall to the root
    slack = math.sqrt(length * length - rise * rise) / width
    x, below = math.sqrt(6.0 * (slack - 1.0)), 0.0
    for _ in range(100):
        below = x - (math.sinh(x) - slack * x) / max(math.cosh(x) - slack, 1e-300)
        if not below < x:
            break
        x = below
    scale = 0.5 * width / max(x, 1e-8)
    middle = 0.5 * (width - scale * math.log((length + rise) / (length - rise)))
    at = [width * i / (pieces + 1) for i in range(1, pieces)]
    floor = math.cosh(middle / scale)
    heights = [scale * (math.cosh((a - middle) / scale) - floor) for a in at]
    points = np.empty((pieces + 1, 3))
    points[0], points[-1] = start, end
    steps = np.array(at)[:, None] * (across / width)
    points[1:-1] = start + steps + np.array(heights)[:, None] * up
    return points


def nearest(center: F64, axis: F64, first: F64, last: F64) -> F64:
    """(n, 3) the point from `first` to `last` that is nearest to a sphere or cylinder."""
    away, span = first - center, last - first
    for part in (away, span):
        part -= dot(part, axis)[:, None] * axis
    share = -dot(away, span) / np.maximum(dot(span, span), 1e-30)
    return np.asarray(first + np.clip(share, 0.0, 1.0)[:, None] * (last - first))


def arc(center: F64, axis: F64, touch: F64, leave: F64) -> list[F64]:
    """2**HALVINGS + 1 times (n, 3): from `touch` to `leave` around a sphere or cylinder."""
    ends = [touch - center, leave - center]
    rises = [dot(end, axis)[:, None] for end in ends]
    # seen along the axis; half-way between two points of a circle is where their sum points
    flat = [end - rise * axis for end, rise in zip(ends, rises, strict=True)]
    radius = np.sqrt(dot(flat[0], flat[0]))
    for _ in range(HALVINGS):
        sums = [one + other for one, other in pairwise(flat)]
        scales = [radius / np.maximum(np.sqrt(dot(s, s)), 1e-30) for s in sums]
        between = [s * scale[:, None] for s, scale in zip(sums, scales, strict=True)]
        flat = [*chain.from_iterable(zip(flat, between, strict=False)), flat[-1]]
    shares = [i / (len(flat) - 1) for i in range(len(flat))]
    climbs = [rises[0] + share * (rises[1] - rises[0]) for share in shares]
    middle = [center + part + climb * axis for part, climb in zip(flat, climbs, strict=True)]
    return [touch, *middle[1:-1], leave]


def dot(a: F64, b: F64) -> F64:
    """(...) of (..., 3), added up in one order everywhere."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def turned(span: F64, length: F64) -> F64:
    """(n, 9) the shortest turn of the z axis into each direction; none where it has none."""
    there = length > 0
    unit = np.where(there[:, None], span, (0.0, 0.0, 1.0)) / np.where(there, length, 1.0)[:, None]
    x, y, z = unit.T
    across = x * x + y * y
    # 1 / (1 + z), exact where z is near -1, too
    share = np.where(z < 0, (1.0 - z) / np.maximum(across, 1e-300), 1.0 / (1.0 + np.abs(z)))
    xx, xy, yy = x * x * share, x * y * share, y * y * share
    turn = np.stack([1.0 - xx, -xy, x, -xy, 1.0 - yy, y, -x, -y, z], 1)
    # straight down: about x
    turn[(across == 0) & (z < 0)] = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)
    return turn
