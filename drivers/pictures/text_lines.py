"""Lines of text in pictures, with Pillow's built-in font."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from evs.msgs.pictures import INK, OFF_RGB, ON_RGB, PAPER, U8

LEGEND = (("ON: brighter", ON_RGB), ("OFF: darker", OFF_RGB))
"""meaning of the two colours"""


@dataclass(frozen=True)
class TextLine:
    """One line of text that is already laid out: a white strip with letters."""

    picture: U8
    """(height, width, 3)"""

    @property
    def width(self) -> int:
        """Size, px."""
        return int(self.picture.shape[1])

    @property
    def height(self) -> int:
        """Size, px."""
        return int(self.picture.shape[0])


def text_line(text: str, size_px: int) -> TextLine:
    """Lay out a text in ink on paper, as wide as its letters; `size_px` is the font's height."""
    letters = font(size_px)
    width, height = max(1, round(letters.getlength(text) + 0.5)), line_height(size_px)
    image = Image.new("L", (width, height), PAPER)
    ImageDraw.Draw(image).text((0, height // 2), text, INK, font=letters, anchor="lm")
    return TextLine(np.repeat(np.asarray(image)[:, :, np.newaxis], 3, axis=2))


def legend_line(size_px: int) -> TextLine:
    """The legend: a square in the colour of each polarity, with its meaning."""
    gap = max(2, size_px // 3)
    side = max(3, size_px * 2 // 3)
    parts: list[U8] = []
    for words, colour in LEGEND:
        label = text_line(words, size_px).picture
        square = np.full((label.shape[0], side, 3), PAPER, np.uint8)
        top = (label.shape[0] - side) // 2
        square[top : top + side] = colour
        if parts:
            parts.append(_blank(label.shape[0], 3 * gap))
        parts += [square, _blank(label.shape[0], gap), label]
    return TextLine(np.concatenate(parts, axis=1))


def side_by_side(left: TextLine, right: TextLine, gap_px: int) -> TextLine:
    """Join two lines of the same height."""
    return TextLine(
        np.concatenate([left.picture, _blank(left.height, gap_px), right.picture], axis=1)
    )


def line_height(size_px: int) -> int:
    """Height of a line of text, px, including letters below the base line."""
    return max(4, round(1.4 * size_px))


def paste(page: U8, picture: U8, left: int, top: int) -> None:
    """Put `picture` on `page`, its top left corner at (left, top). It must lie inside."""
    height, width = picture.shape[:2]
    if left < 0 or top < 0 or left + width > page.shape[1] or top + height > page.shape[0]:
        raise ValueError(
            f"{width} x {height} at ({left}, {top}) leaves a page of {page.shape[1::-1]}"
        )
    page[top : top + height, left : left + width] = picture


def _blank(height: int, width: int) -> U8:
    return np.full((height, width, 3), PAPER, np.uint8)


@cache
def font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's built-in font of this height. It has Latin letters, no Greek."""
    return ImageFont.load_default(size_px)
