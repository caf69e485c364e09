"""Names beside the points of a chart, so that none covers a point, a line or another name."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from evs.drivers.pictures.chart import RGB, Chart, Series, colour_of

POINT_PX = 5.0
NAME_PT = 8.5
REACHED_PX = 18.0
"""a name nearer than this needs no line to its point"""
GAP_PX = 3.0
"""space between a label and everything else"""

Box = tuple[float, float, float, float]
"""left, bottom, right, top, px"""

_WAYS = tuple(
    (math.cos(angle), math.sin(angle))
    for angle in (math.radians(degrees) for degrees in (0, 180, 45, -45, 135, -135, 90, -90))
)
"""directions from the point; right and left are the most readable"""


@dataclass(frozen=True)
class NamedSeries(Series):
    """Points that have names."""

    names: Sequence[str] = ()
    """of each, drawn only where there is space"""
    reach_px: float = 30.0
    """how far from its point a name may lie; a thin line leads to a distant one"""


@dataclass(frozen=True)
class Label:
    """A label to be placed."""

    at: tuple[float, float]
    """the point it belongs to, px"""
    size: tuple[float, float]
    """width, height of the words, px"""
    reach_px: float
    """how far from its point it may stand"""


class Name(NamedTuple):
    """A name with its position next to a point."""

    words: str
    at: tuple[float, float]
    """of the point, px"""
    box: Box
    colour: RGB


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
    occupied = list(taken)
    found: list[Box | None] = []
    for label in labels:
        box = _free(label, occupied, frame, nearest_px)
        if box is not None:
            occupied.append(box)
        found.append(box)
    return found


def _free(label: Label, occupied: Sequence[Box], frame: Box, nearest_px: float) -> Box | None:
    """The nearest free box."""
    width, height = label.size
    reach = nearest_px
    while reach <= label.reach_px:
        for across, up in _WAYS:
            # the near edge or corner of the box lies `reach` away
            x = label.at[0] + reach * across + 0.5 * width * (_sign(across) - 1.0)
            y = label.at[1] + reach * up + 0.5 * height * (_sign(up) - 1.0)
            box = (x, y, x + width, y + height)
            inside = (
                box[0] >= frame[0]
                and box[1] >= frame[1]
                and box[2] <= frame[2]
                and box[3] <= frame[3]
            )
            if inside and not any(overlap(box, other, GAP_PX) for other in occupied):
                return box
        reach += 4.0
    return None


def _sign(value: float) -> float:
    return 0.0 if abs(value) < 1e-9 else math.copysign(1.0, value)


def write_names(axes: Any, chart: Chart) -> list[Name]:
    """Write the names of the NamedSeries of a chart on its axes; return those with space.

    Names that may lie far from their points are placed first.
    """
    found = names_of(axes, chart)
    for words, at, (left, bottom, right, top), colour in found:
        near = (min(max(at[0], left), right), min(max(at[1], bottom), top))
        line = {"arrowstyle": "-", "lw": 0.5, "color": colour_of(colour), "shrinkA": 0}
        axes.annotate(
            words, at, (left, bottom), xycoords="figure pixels", textcoords="figure pixels",
            fontsize=NAME_PT, color=colour_of(colour),
            arrowprops=line if math.dist(at, near) > REACHED_PX else None,
        )  # fmt: skip
    return found


def names_of(axes: Any, chart: Chart) -> list[Name]:
    """Place the names inside the axes, without overlap with points, lines and other texts."""
    frame = axes.get_window_extent().extents
    taken: list[Box] = [tuple(text.get_window_extent().extents) for text in axes.texts]
    if axes.get_legend() is not None:
        taken.append(tuple(axes.get_legend().get_window_extent().extents))
    names: list[tuple[str, RGB, Label]] = []
    for series in chart.series:
        values = np.stack([np.asarray(series.x, float), np.asarray(series.y, float)], 1)
        places = axes.transData.transform(values) if len(values) else values
        if series.line:
            taken += _along(places)
            continue
        taken += [(x - POINT_PX, y - POINT_PX, x + POINT_PX, y + POINT_PX) for x, y in places]
        for (low, high), (_, y) in zip(series.x_range, places, strict=False):
            ends = axes.transData.transform([(low, series.y[0]), (high, series.y[0])])
            taken.append((ends[0, 0], y - 1.0, ends[1, 0], y + 1.0))
        if isinstance(series, NamedSeries):
            for (x, y), words in zip(places, series.names, strict=True):
                text = axes.text(0, 0, words, fontsize=NAME_PT)
                box = text.get_window_extent()
                text.remove()
                label = Label((x, y), (box.width, box.height), series.reach_px)
                names.append((words, series.colour, label))
    names.sort(key=lambda one: -one[2].reach_px)
    boxes = place_labels([label for _, _, label in names], taken, tuple(frame), POINT_PX + 3.0)
    return [
        Name(words, label.at, box, colour)
        for (words, colour, label), box in zip(names, boxes, strict=True)
        if box is not None
    ]


def _along(places: Any) -> list[Box]:
    """Small boxes all along a line."""
    found = []
    for one, two in itertools.pairwise(places):
        for share in np.linspace(0.0, 1.0, 1 + int(math.dist(one, two) / 6.0)):
            x, y = one + share * (two - one)
            found.append((x - 1.0, y - 1.0, x + 1.0, y + 1.0))
    return found
