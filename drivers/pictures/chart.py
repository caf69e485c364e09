"""A chart: lines and points between two axes. Arrays in, a picture out.

It is drawn a few times larger and then made smaller, so that lines and letters are smooth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from evs.drivers.pictures.colours import INK, PAPER, U8
from evs.drivers.pictures.lettering import font
from evs.drivers.pictures.scales import Scale

FINE = 3
"""How many times larger a chart is drawn."""

LEVELS = 8
"""Shades of each colour of a map: more cannot be told apart, and make files large."""

RGB = tuple[int, int, int]
GREY: RGB = (120, 120, 120)
GRID: RGB = (232, 232, 232)
FAINT_GRID: RGB = (244, 244, 244)
INK_RGB: RGB = (INK, INK, INK)
PAPER_RGB: RGB = (PAPER, PAPER, PAPER)

LETTER_PX = 14
TITLE_PX = 17
POINT_PX = 4.0
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 76, 26, 62, 52
PICTURE_AT = (LEFT_PX - 58, TOP_PX)
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
    """points: rings of this radius around other points; 0: discs"""


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
    empty: str = ""
    """what to say where there is nothing to show"""
    picture: U8 | None = None
    """(h, w, 3) shown in place of the axes"""
    below: str = ""
    """words under the picture"""


def draw_chart(chart: Chart, width: int, height: int) -> U8:
    """(height, width, 3)."""
    image = Image.new("RGB", (width * FINE, height * FINE), PAPER_RGB)
    pen = _Pen(ImageDraw.Draw(image))
    pen.text((LEFT_PX - 58, 10), chart.title, TITLE_PX, "la", INK_RGB)
    frame = (LEFT_PX, TOP_PX, width - RIGHT_PX, height - BOTTOM_PX)
    if chart.picture is not None:
        _frame_picture(pen, chart, _picture_size(chart, width, height))
    else:
        _axes(pen, chart, frame)
        for series in chart.series:
            _series(pen, chart, series, frame)
        _legend(pen, chart)
        if chart.empty:
            middle = (0.5 * (frame[0] + frame[2]), 0.5 * (frame[1] + frame[3]))
            pen.text(middle, chart.empty, LETTER_PX, "mm", GREY)
    small = image.resize((width, height), Image.Resampling.LANCZOS)
    if chart.picture is not None:
        # as it is: its pixels need no smoothing
        size = _picture_size(chart, width, height)
        way = (
            Image.Resampling.NEAREST if size[0] >= chart.picture.shape[1] else Image.Resampling.BOX
        )
        small.paste(Image.fromarray(chart.picture).resize(size, way), PICTURE_AT)
    return np.asarray(small)


def diverging(share: npt.NDArray[np.float64]) -> U8:
    """(...) numbers -1 ... 1 as blue, white, red (..., 3); NaN is grey."""
    there = np.isfinite(share)
    place = np.rint(LEVELS * np.clip(np.nan_to_num(share), -1.0, 1.0)) / LEVELS
    stops = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    colours = np.array(
        [(20, 66, 140), (110, 168, 219), (247, 247, 247), (240, 150, 110), (160, 24, 32)],
        np.float64,
    )
    mixed = np.stack([np.interp(place, stops, colours[:, k]) for k in range(3)], axis=-1)
    return np.where(there[..., np.newaxis], mixed, 150.0).astype(np.uint8)


class _Pen:
    """Draws in px of the finished chart."""

    def __init__(self, draw: ImageDraw.ImageDraw) -> None:
        self._draw = draw

    def line(self, points: Sequence[tuple[float, float]], colour: RGB, width: float) -> None:
        """Through all of them."""
        if len(points) > 1:
            large = [(FINE * x, FINE * y) for x, y in points]
            self._draw.line(large, colour, max(1, round(FINE * width)), joint="curve")

    def dot(self, at: tuple[float, float], colour: RGB) -> None:
        """A disc with a little paper around it."""
        for r, fill in ((POINT_PX + 1.0, PAPER_RGB), (POINT_PX, colour)):
            self._draw.ellipse(self._box(at, r), fill)

    def ring(self, at: tuple[float, float], radius: float, colour: RGB) -> None:
        """A circle around a disc."""
        self._draw.ellipse(self._box(at, radius), outline=colour, width=round(1.6 * FINE))

    def _box(self, at: tuple[float, float], r: float) -> list[float]:
        return [FINE * (at[0] - r), FINE * (at[1] - r), FINE * (at[0] + r), FINE * (at[1] + r)]

    def text(
        self, at: tuple[float, float], words: str, size: int, anchor: str, colour: RGB
    ) -> None:
        """Anchor as Pillow has it."""
        place = (FINE * at[0], FINE * at[1])
        self._draw.text(place, words, colour, font=font(FINE * size), anchor=anchor)

    def width(self, words: str, size: int) -> float:
        """Of a text, px."""
        return font(FINE * size).getlength(words) / FINE


Frame = tuple[float, float, float, float]


def _at(chart: Chart, frame: Frame, x: float, y: float) -> tuple[float, float]:
    left, top, right, bottom = frame
    return (
        left + chart.x.place(x) * (right - left),
        bottom - chart.y.place(y) * (bottom - top),
    )


def _axes(pen: _Pen, chart: Chart, frame: Frame) -> None:
    left, top, right, bottom = frame
    for values, vertical in ((chart.x.minor(), True), (chart.y.minor(), False)):
        for value in values:
            _grid_line(pen, chart, frame, value, vertical, FAINT_GRID)
    for value, words in chart.x.ticks():
        _grid_line(pen, chart, frame, value, True, GRID)
        x = _at(chart, frame, value, chart.y.low)[0]
        pen.text((x, bottom + 6), words, LETTER_PX, "ma", INK_RGB)
    for value, words in chart.y.ticks():
        _grid_line(pen, chart, frame, value, False, GRID)
        y = _at(chart, frame, chart.x.low, value)[1]
        pen.text((left - 7, y), words, LETTER_PX, "rm", INK_RGB)
    pen.line([(left, top), (left, bottom), (right, bottom)], GREY, 1.0)
    pen.text(((left + right) / 2, bottom + 26), chart.x_label, LETTER_PX, "ma", GREY)
    for level, words in chart.marks:
        y = _at(chart, frame, chart.x.low, level)[1]
        for x in np.arange(left, right, 9.0):
            pen.line([(x, y), (min(x + 5.0, right), y)], GREY, 1.0)
        pen.text((right - 2, y - 3), words, LETTER_PX - 1, "rs", GREY)


def _grid_line(
    pen: _Pen, chart: Chart, frame: Frame, value: float, vertical: bool, colour: RGB
) -> None:
    left, top, right, bottom = frame
    if vertical:
        x = _at(chart, frame, value, chart.y.low)[0]
        pen.line([(x, top), (x, bottom)], colour, 1.0)
    else:
        y = _at(chart, frame, chart.x.low, value)[1]
        pen.line([(left, y), (right, y)], colour, 1.0)


def _series(pen: _Pen, chart: Chart, series: Series, frame: Frame) -> None:
    """Points outside the axes are left out, lines end where they leave them."""
    left, top, right, bottom = frame
    places = [_at(chart, frame, x, y) for x, y in zip(series.x, series.y, strict=True)]
    inside = [
        math.isfinite(x + y) and left - 1 <= x <= right + 1 and top - 1 <= y <= bottom + 1
        for x, y in places
    ]
    if series.line:
        run: list[tuple[float, float]] = []
        for place, shown in zip(places, inside, strict=True):
            if shown:
                run.append(place)
                continue
            pen.line(run, series.colour, 2.0)
            run = []
        pen.line(run, series.colour, 2.0)
        return
    for k, place in enumerate(places):
        if not inside[k]:
            continue
        if series.error and math.isfinite(series.error[k]):
            ends = [
                _at(chart, frame, series.x[k], series.y[k] + sign * series.error[k])
                for sign in (-1.0, 1.0)
            ]
            if all(math.isfinite(y) for _, y in ends):
                held = [(x, min(max(y, top), bottom)) for x, y in ends]
                pen.line(held, series.colour, 1.5)
        if series.ring_px:
            pen.ring(place, series.ring_px, series.colour)
        else:
            pen.dot(place, series.colour)


def _legend(pen: _Pen, chart: Chart) -> None:
    """Under the title, in one row."""
    x, y = LEFT_PX - 58.0, 44.0
    for series in chart.series:
        if not series.label:
            continue
        if series.ring_px:
            pen.ring((x + series.ring_px, y), series.ring_px, series.colour)
            x += 2.0 * series.ring_px + 5
        else:
            pen.dot((x + 5, y), series.colour)
            x += 14
        pen.text((x, y), series.label, LETTER_PX, "lm", INK_RGB)
        x += pen.width(series.label, LETTER_PX) + 16


def _picture_size(chart: Chart, width: int, height: int) -> tuple[int, int]:
    """Of the picture on the chart: whole pixels of it are whole pixels here, where it fits."""
    assert chart.picture is not None
    rows, columns = chart.picture.shape[:2]
    room = (width - 2 * RIGHT_PX - 16, height - TOP_PX - BOTTOM_PX + 14)
    factor = min(room[0] / columns, room[1] / rows)
    factor = math.floor(factor) if factor >= 1.0 else factor
    return max(1, round(columns * factor)), max(1, round(rows * factor))


def _frame_picture(pen: _Pen, chart: Chart, size: tuple[int, int]) -> None:
    left, top = PICTURE_AT[0] - 0.5, PICTURE_AT[1] - 0.5
    right, bottom = left + size[0] + 1, top + size[1] + 1
    pen.line([(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], GREY, 1.0)
    pen.text((left, 44), chart.below, LETTER_PX, "lm", INK_RGB)
