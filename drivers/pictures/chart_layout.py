"""The content of a chart, and the positions of its values, px. Nothing is drawn here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from evs.drivers.pictures.colours import U8
from evs.drivers.pictures.label_placement import Box
from evs.drivers.pictures.pen import RGB
from evs.drivers.pictures.scales import Scale

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
