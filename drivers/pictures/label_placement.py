"""Placement of labels next to points without overlap: geometry only, no pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

Box = tuple[float, float, float, float]
"""left, top, right, bottom, px"""

_WAYS = tuple(
    (math.cos(angle), math.sin(angle))
    for angle in (math.radians(degrees) for degrees in (0, 180, -45, 45, -135, 135, -90, 90))
)
"""directions from the point; right and left are the most readable"""

GAP_PX = 3.0
"""space between a label and everything else"""


@dataclass(frozen=True)
class Label:
    """A label to be placed."""

    at: tuple[float, float]
    """the point it belongs to, px"""
    size: tuple[float, float]
    """width, height of the words, px"""
    reach_px: float
    """how far from its point it may stand"""


def overlap(one: Box, other: Box, gap: float = 0.0) -> bool:
    """Whether two boxes have inner points in common, or come nearer than a gap."""
    return (
        one[0] < other[2] + gap
        and other[0] < one[2] + gap
        and one[1] < other[3] + gap
        and other[1] < one[3] + gap
    )


def place_labels(
    labels: Sequence[Label], taken: Sequence[Box], frame: Box, nearest_px: float
) -> list[Box | None]:
    """Place labels so that none leaves the frame or touches another label or a taken box.

    Args:
        labels: The labels, the most important first.
        taken: Boxes to keep free, such as those of the points.
        frame: The box that holds all labels.
        nearest_px: Least distance from a point to its label.

    Returns:
        A box for each label; None where there is no space.
    """
    held = list(taken)
    found: list[Box | None] = []
    for label in labels:
        box = _free(label, held, frame, nearest_px)
        if box is not None:
            held.append(box)
        found.append(box)
    return found


def _free(label: Label, held: Sequence[Box], frame: Box, nearest_px: float) -> Box | None:
    """The nearest free box."""
    width, height = label.size
    reach = nearest_px
    while reach <= label.reach_px:
        for across, down in _WAYS:
            # the near edge or corner of the box lies `reach` away
            x = label.at[0] + reach * across + 0.5 * width * (_sign(across) - 1.0)
            y = label.at[1] + reach * down + 0.5 * height * (_sign(down) - 1.0)
            box = (x, y, x + width, y + height)
            inside = (
                box[0] >= frame[0]
                and box[1] >= frame[1]
                and box[2] <= frame[2]
                and box[3] <= frame[3]
            )
            if inside and not any(overlap(box, other, GAP_PX) for other in held):
                return box
        reach += 4.0
    return None


def _sign(value: float) -> float:
    return 0.0 if abs(value) < 1e-9 else math.copysign(1.0, value)
