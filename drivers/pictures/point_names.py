"""Positions of the names of points on a chart."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evs.drivers.pictures.chart_layout import (
    LETTER_PX,
    NAME_PX,
    Chart,
    Place,
    Series,
    frame_of,
    levels,
    place_of,
)
from evs.drivers.pictures.label_placement import Box, Label, place_labels
from evs.drivers.pictures.pen import POINT_PX, RGB, text_width


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
    asked: list[tuple[str, RGB, Label]] = []
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
                asked.append((words, series.colour, Label(place, size, series.reach_px)))
    for _, _, (at, words, anchor) in levels(chart, frame):
        left = at[0] - (text_width(words, LETTER_PX - 1) if anchor == "rs" else 0.0)
        top = at[1] - (LETTER_PX if anchor == "rs" else 0.0)
        taken.append((left, top, left + text_width(words, LETTER_PX - 1), top + LETTER_PX))
    asked.sort(key=lambda one: -one[2].reach_px)
    boxes = place_labels([label for _, _, label in asked], taken, frame, POINT_PX + 4.0)
    return [
        Name(words, label.at, box, colour)
        for (words, colour, label), box in zip(asked, boxes, strict=True)
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
