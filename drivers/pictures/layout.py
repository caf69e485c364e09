"""What a chart shows, and where each number of it lies, px. Nothing is drawn here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from evs.drivers.pictures.colours import U8
from evs.drivers.pictures.labels import Box
from evs.drivers.pictures.pen import RGB
from evs.drivers.pictures.scales import Scale

LETTER_PX = 14
TITLE_PX = 17
NAME_PX = 12
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 76, 26, 62, 52
"""Margins of the axes, px."""


@dataclass(frozen=True)
class Series:
    """Values of y over x: points that were measured, or a line that was promised."""

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
    """points: words beside each; they stand only where there is room"""
    reach_px: float = 30.0
    """how far from its point a name may stand; when it is far a thin line leads there"""


@dataclass(frozen=True)
class Chart:
    """What one panel shows."""

    title: str
    x: Scale
    y: Scale
    x_label: str
    series: Sequence[Series] = ()
    marks: Sequence[tuple[float, str]] = ()
    """levels of y that have a dashed line and a word"""
    posts: Sequence[tuple[float, str]] = ()
    """levels of x that have one"""
    empty: str = ""
    """what to say where there is nothing to show"""
    picture: U8 | None = None
    """(h, w, 3) shown in place of the axes"""
    below: str = ""
    """words under the picture"""


Place = tuple[float, float]


def frame_of(width: int, height: int) -> Box:
    """Of the axes."""
    return LEFT_PX, TOP_PX, width - RIGHT_PX, height - BOTTOM_PX


def place_of(chart: Chart, frame: Box, x: float, y: float) -> Place:
    """Of a number on both axes, px; NaN where it has none."""
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
