"""A pen for charts: lines, marks and texts in px of the finished picture.

It draws several times larger; the picture is reduced afterwards, so that lines and letters are
smooth.
"""

from __future__ import annotations

from collections.abc import Sequence

from PIL import ImageDraw

from evs.drivers.pictures.text_lines import font
from evs.msgs.pictures import INK, PAPER

FINE = 3
"""How many times larger a chart is drawn."""

RGB = tuple[int, int, int]
GREY: RGB = (120, 120, 120)
INK_RGB: RGB = (INK, INK, INK)
PAPER_RGB: RGB = (PAPER, PAPER, PAPER)

POINT_PX = 4.0

MARKS = ("disc", "circle", "square", "diamond", "triangle")
"""Shapes of a point."""


class Pen:
    """Draws in px of the finished chart."""

    def __init__(self, draw: ImageDraw.ImageDraw) -> None:
        self._draw = draw

    def line(self, points: Sequence[tuple[float, float]], colour: RGB, width: float) -> None:
        """Draw a line through all points."""
        if len(points) > 1:
            large = [(FINE * x, FINE * y) for x, y in points]
            self._draw.line(large, colour, max(1, round(FINE * width)), joint="curve")

    def dot(self, at: tuple[float, float], colour: RGB, mark: str = "disc") -> None:
        """Draw a mark, one of MARKS, with a little paper around it; a circle is empty."""
        x, y = FINE * at[0], FINE * at[1]
        for r, fill in ((POINT_PX + 1.0, PAPER_RGB), (POINT_PX, colour)):
            if mark == "square":
                self._draw.rectangle(self._box(at, 0.9 * r), fill)
            elif mark in ("diamond", "triangle"):
                far = 1.3 * FINE * r
                corners = [(x, y - far), (x + far, y), (x, y + far), (x - far, y)]
                if mark == "triangle":
                    corners = [(x, y - far), (x + far, y + 0.8 * far), (x - far, y + 0.8 * far)]
                self._draw.polygon(corners, fill)
            else:
                self._draw.ellipse(self._box(at, r), fill)
        if mark == "circle":
            self._draw.ellipse(self._box(at, POINT_PX - 1.5), PAPER_RGB)

    def ring(self, at: tuple[float, float], radius: float, colour: RGB) -> None:
        """Draw a ring around a point."""
        self._draw.ellipse(self._box(at, radius), outline=colour, width=round(1.6 * FINE))

    def _box(self, at: tuple[float, float], r: float) -> list[float]:
        return [FINE * (at[0] - r), FINE * (at[1] - r), FINE * (at[0] + r), FINE * (at[1] + r)]

    def text(
        self, at: tuple[float, float], words: str, size: int, anchor: str, colour: RGB
    ) -> None:
        """Draw a text; `anchor` is one of Pillow's."""
        place = (FINE * at[0], FINE * at[1])
        self._draw.text(place, words, colour, font=font(FINE * size), anchor=anchor)


def text_width(words: str, size: int) -> float:
    """Width of a text on a chart, px."""
    return font(FINE * size).getlength(words) / FINE
