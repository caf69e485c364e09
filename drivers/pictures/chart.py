"""A chart: lines and points between two axes. Arrays in, a picture out."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from evs.drivers.pictures.chart_layout import (
    BOTTOM_PX,
    LEFT_PX,
    LETTER_PX,
    NAME_PX,
    RIGHT_PX,
    TITLE_PX,
    TOP_PX,
    Box,
    Chart,
    Name,
    Place,
    Series,
    frame_of,
    levels,
    names_of,
    place_of,
)
from evs.drivers.pictures.pen import FINE, GREY, INK_RGB, PAPER_RGB, RGB, Pen, text_width
from evs.msgs.pictures import U8

PICTURE_AT = (LEFT_PX - 58, TOP_PX)

REACHED_PX = 18.0
"""a name nearer than this needs no line to its point"""

LEVELS = 8
"""Shades of each colour of a map: more are hard to distinguish, and make files large."""

GRID: RGB = (232, 232, 232)
FAINT_GRID: RGB = (244, 244, 244)


def draw_chart(chart: Chart, width: int, height: int) -> U8:
    """(height, width, 3)."""
    image = Image.new("RGB", (width * FINE, height * FINE), PAPER_RGB)
    pen = Pen(ImageDraw.Draw(image))
    pen.text((LEFT_PX - 58, 10), chart.title, TITLE_PX, "la", INK_RGB)
    frame = frame_of(width, height)
    if chart.picture is not None:
        _frame_picture(pen, chart, _picture_size(chart, width, height))
    else:
        _axes(pen, chart, frame)
        for series in chart.series:
            _series(pen, chart, series, frame)
        for name in names_of(chart, width, height):
            _write(pen, name)
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
    finite = np.isfinite(share)
    place = np.rint(LEVELS * np.clip(np.nan_to_num(share), -1.0, 1.0)) / LEVELS
    stops = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    colours = np.array(
        [(20, 66, 140), (110, 168, 219), (247, 247, 247), (240, 150, 110), (160, 24, 32)],
        np.float64,
    )
    mixed = np.stack([np.interp(place, stops, colours[:, k]) for k in range(3)], axis=-1)
    return np.where(finite[..., np.newaxis], mixed, 150.0).astype(np.uint8)


def _axes(pen: Pen, chart: Chart, frame: Box) -> None:
    left, top, right, bottom = frame
    for values, vertical in ((chart.x.minor(), True), (chart.y.minor(), False)):
        for value in values:
            _grid_line(pen, chart, frame, value, vertical, FAINT_GRID)
    for value, words in chart.x.ticks():
        _grid_line(pen, chart, frame, value, True, GRID)
        x = place_of(chart, frame, value, chart.y.low)[0]
        pen.text((x, bottom + 6), words, LETTER_PX, "ma", INK_RGB)
    for value, words in chart.y.ticks():
        _grid_line(pen, chart, frame, value, False, GRID)
        y = place_of(chart, frame, chart.x.low, value)[1]
        pen.text((left - 7, y), words, LETTER_PX, "rm", INK_RGB)
    pen.line([(left, top), (left, bottom), (right, bottom)], GREY, 1.0)
    pen.text(((left + right) / 2, bottom + 26), chart.x_label, LETTER_PX, "ma", GREY)
    for at, end, (word_at, words, anchor) in levels(chart, frame):
        _dashes(pen, at, end)
        pen.text(word_at, words, LETTER_PX - 1, anchor, GREY)


def _dashes(pen: Pen, at: Place, end: Place) -> None:
    length = math.dist(at, end)
    for begin in np.arange(0.0, length, 9.0):
        ends = [begin / length, min(begin + 5.0, length) / length]
        pen.line([(at[0] + s * (end[0] - at[0]), at[1] + s * (end[1] - at[1])) for s in ends],
                 GREY, 1.0)  # fmt: skip


def _grid_line(
    pen: Pen, chart: Chart, frame: Box, value: float, vertical: bool, colour: RGB
) -> None:
    left, top, right, bottom = frame
    if vertical:
        x = place_of(chart, frame, value, chart.y.low)[0]
        pen.line([(x, top), (x, bottom)], colour, 1.0)
    else:
        y = place_of(chart, frame, chart.x.low, value)[1]
        pen.line([(left, y), (right, y)], colour, 1.0)


def _series(pen: Pen, chart: Chart, series: Series, frame: Box) -> None:
    """Points outside the axes are left out, lines end where they leave them."""
    left, top, right, bottom = frame
    places = [place_of(chart, frame, x, y) for x, y in zip(series.x, series.y, strict=True)]
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
                place_of(chart, frame, series.x[k], series.y[k] + sign * series.error[k])
                for sign in (-1.0, 1.0)
            ]
            if all(math.isfinite(y) for _, y in ends):
                clipped = [(x, min(max(y, top), bottom)) for x, y in ends]
                pen.line(clipped, series.colour, 1.5)
        if series.x_range:
            ends = [place_of(chart, frame, x, series.y[k]) for x in series.x_range[k]]
            if all(math.isfinite(x) for x, _ in ends):
                pen.line([(min(max(x, left), right), y) for x, y in ends], _pale(series.colour), 1)
        if series.ring_px:
            pen.ring(place, series.ring_px, series.colour)
        else:
            pen.dot(place, series.colour, series.mark)


def _pale(colour: RGB) -> RGB:
    """Half way to the paper."""
    red, green, blue = ((one + paper) // 2 for one, paper in zip(colour, PAPER_RGB, strict=True))
    return red, green, blue


def _legend(pen: Pen, chart: Chart) -> None:
    """Under the title, in one row."""
    x, y = LEFT_PX - 58.0, 44.0
    for series in chart.series:
        if not series.label:
            continue
        if series.ring_px:
            pen.ring((x + series.ring_px, y), series.ring_px, series.colour)
            x += 2.0 * series.ring_px + 5
        else:
            pen.dot((x + 5, y), series.colour, series.mark)
            x += 14
        pen.text((x, y), series.label, LETTER_PX, "lm", INK_RGB)
        x += text_width(series.label, LETTER_PX) + 16


def _write(pen: Pen, name: Name) -> None:
    left, top, right, bottom = name.box
    x, y = name.at
    near = (min(max(x, left), right), min(max(y, top), bottom))
    if math.dist(name.at, near) > REACHED_PX:
        pen.line([name.at, near], name.colour, 0.7)
    pen.text((left, 0.5 * (top + bottom)), name.words, NAME_PX, "lm", name.colour)


def _picture_size(chart: Chart, width: int, height: int) -> tuple[int, int]:
    """Of the picture on the chart: whole pixels of it are whole pixels here, where it fits."""
    assert chart.picture is not None
    rows, columns = chart.picture.shape[:2]
    room = (width - 2 * RIGHT_PX - 16, height - TOP_PX - BOTTOM_PX + 14)
    factor = min(room[0] / columns, room[1] / rows)
    factor = math.floor(factor) if factor >= 1.0 else factor
    return max(1, round(columns * factor)), max(1, round(rows * factor))


def _frame_picture(pen: Pen, chart: Chart, size: tuple[int, int]) -> None:
    left, top = PICTURE_AT[0] - 0.5, PICTURE_AT[1] - 0.5
    right, bottom = left + size[0] + 1, top + size[1] + 1
    pen.line([(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], GREY, 1.0)
    pen.text((left, 44), chart.below, LETTER_PX, "lm", INK_RGB)
