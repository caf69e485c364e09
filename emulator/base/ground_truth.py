"""Ground truth: what each pixel's centre shows, and how fast its image moves.

Where a ray hits nothing: depth and distance are infinite, position and normal NaN, both ids -1,
and the flow is that of a point at infinity.
"""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.base.scene import F32, I32


@dataclass(frozen=True)
class GroundTruth:
    """Of the first surface, opaque or not, on the ray through each pixel's centre."""

    t_us: int
    depth: F32
    """(h, w) along the optical axis, m; negative for what a fisheye sees behind itself"""
    distance: F32
    """(h, w) along the ray, m"""
    normal: F32
    """(h, w, 3) shading normal, unit, world frame, turned to the camera; no normal maps"""
    position: F32
    """(h, w, 3) of the point that is seen, world frame, m"""
    geom_id: I32
    """(h, w) MuJoCo's geom id, -1 nothing; skin i is -2 - i, flex i (a rope too) -2 - nskin - i,
    site i -2 - nskin - nflex - i, tendon i -2 - nskin - nflex - nsite - i, and slider-cranks, by
    their actuator's id, after those"""
    body_id: I32
    """(h, w) MuJoCo's body id, 0 the world; -1 nothing, or a thing that hangs on many bodies"""
    flow: F32
    """(h, w, 2) px/s, x to the right, y down: the mean velocity, since the previous snapshot, of
    the image of the point that is seen now, which moved with its body (on a skin or flex: with its
    triangle; on a tendon or rope: with the stretch from corner to corner that it is on). It belongs
    to the events between the two. NaN where that point was behind the camera, and everywhere
    without a previous snapshot. An orthographic camera has no image of what lies at infinity: 0
    there."""
