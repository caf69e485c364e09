"""The content of a chart, the positions of its values, and its labels, px; nothing is drawn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from evs.drivers.pictures.pen import POINT_PX, RGB, text_width
from evs.drivers.pictures.scales import Scale
from evs.msgs.pictures import U8

LETTER_PX = 14
TITLE_PX = 17
NAME_PX = 12
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 76, 26, 62, 52
"""Margins of the axes, px."""


@dataclass(frozen=True)
class Series:
    """Values of y over x: measured points, or a reference line."""

    x: Sequence[float]
    y: Sequence[float]
    colour: RGB
    label: str = ""
    """for the legend; empty: it has none"""
    line: bool = False
    """a line through them; else points"""
    error: Sequence[float] = ()
    """half the length of each point's bar"""
    ring_px: float = 0.0
    """points: rings of this radius around other points; 0: marks"""
    mark: str = "disc"
    """points: one of pen.MARKS"""
    x_range: Sequence[tuple[float, float]] = ()
    """points: (low, high) of each one's bar along x"""
    names: Sequence[str] = ()
    """points: name of each, drawn only where there is space"""
    reach_px: float = 30.0
    """how far from its point a name may lie; a thin line leads to a distant one"""


@dataclass(frozen=True)
class Chart:
    """The content of one panel."""

    title: str
    x: Scale
    y: Scale
    x_label: str
    series: Sequence[Series] = ()
    marks: Sequence[tuple[float, str]] = ()
    """levels of y with a dashed line, and its text"""
    posts: Sequence[tuple[float, str]] = ()
    """levels of x with a dashed line, and its text"""
    empty: str = ""
    """text where there is nothing to show"""
    picture: U8 | None = None
    """(h, w, 3) shown in place of the axes"""
    below: str = ""
    """words under the picture"""


Place = tuple[float, float]


def frame_of(width: int, height: int) -> Box:
    """The box of the axes, px."""
    return LEFT_PX, TOP_PX, width - RIGHT_PX, height - BOTTOM_PX


def place_of(chart: Chart, frame: Box, x: float, y: float) -> Place:
    """Position of a point, px; NaN where a value has none."""
    left, top, right, bottom = frame
    return (
        left + chart.x.place(x) * (right - left),
        bottom - chart.y.place(y) * (bottom - top),
    )


Word = tuple[tuple[float, float], str, str]
"""place, words, anchor as Pillow has it"""


def levels(chart: Chart, frame: Box) -> Iterator[tuple[Place, Place, Word]]:
    """Both ends of each dashed line, and its word."""
    left, top, right, bottom = frame
    for level, words in chart.marks:
        y = place_of(chart, frame, chart.x.low, level)[1]
        yield (left, y), (right, y), ((right - 2, y - 3), words, "rs")
    for level, words in chart.posts:
        x = place_of(chart, frame, level, chart.y.low)[0]
        yield (x, top), (x, bottom), ((x + 4, top + 2), words, "la")


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
            if inside and not any(overlap(box, other, GAP_PX) for other in occupied):
                return box
        reach += 4.0
    return None


def _sign(value: float) -> float:
    return 0.0 if abs(value) < 1e-9 else math.copysign(1.0, value)


@dataclass(frozen=True)
class Name:
    """A name with its position next to a point."""

    words: str
    at: Place
    """of the point, px"""
    box: Box
    colour: RGB


def names_of(chart: Chart, width: int, height: int) -> list[Name]:
    """Place the names of points inside the axes, without overlap with anything else.

    Names that may lie far from their points are placed first. A name without space is left out.
    """
    frame = frame_of(width, height)
    names: list[tuple[str, RGB, Label]] = []
    taken: list[Box] = []
    for series in chart.series:
        places = [place_of(chart, frame, x, y) for x, y in zip(series.x, series.y, strict=True)]
        inside = [place for place in places if math.isfinite(sum(place))]
        if series.line:
            taken += _along(inside)
            continue
        taken += [_around(place) for place in inside]
        taken += [box for k in range(len(series.x_range)) for box in _bar(chart, series, k, frame)]
        for place, words in zip(places, series.names, strict=False):
            if words and math.isfinite(sum(place)):
                size = (text_width(words, NAME_PX), 1.15 * NAME_PX)
                names.append((words, series.colour, Label(place, size, series.reach_px)))
    for _, _, (at, words, anchor) in levels(chart, frame):
        left = at[0] - (text_width(words, LETTER_PX - 1) if anchor == "rs" else 0.0)
        top = at[1] - (LETTER_PX if anchor == "rs" else 0.0)
        taken.append((left, top, left + text_width(words, LETTER_PX - 1), top + LETTER_PX))
    names.sort(key=lambda one: -one[2].reach_px)
    boxes = place_labels([label for _, _, label in names], taken, frame, POINT_PX + 4.0)
    return [
        Name(words, label.at, box, colour)
        for (words, colour, label), box in zip(names, boxes, strict=True)
        if box is not None
    ]


def _around(place: Place) -> Box:
    return (place[0] - POINT_PX, place[1] - POINT_PX, place[0] + POINT_PX, place[1] + POINT_PX)


def _bar(chart: Chart, series: Series, k: int, frame: Box) -> list[Box]:
    """The bar along x of a point."""
    ends = [place_of(chart, frame, x, series.y[k]) for x in series.x_range[k]]
    if not all(math.isfinite(x + y) for x, y in ends):
        return []
    (left, y), (right, _) = ends
    return [(left, y - 1.0, right, y + 1.0)]


def _along(places: Sequence[Place]) -> list[Box]:
    """Small boxes all along a line."""
    found = []
    for one, two in itertools.pairwise(places):
        for share in np.linspace(0.0, 1.0, 1 + int(math.dist(one, two) / 6.0)):
            x, y = one[0] + share * (two[0] - one[0]), one[1] + share * (two[1] - one[1])
            found.append((x - 1.0, y - 1.0, x + 1.0, y + 1.0))
    return found
