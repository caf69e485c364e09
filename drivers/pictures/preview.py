"""One still picture of a recording: a few instants side by side, with captions and a legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evs.drivers.pictures.frame import count_polarities, upscale, whole_factor
from evs.drivers.pictures.image_files import check_size
from evs.drivers.pictures.text_lines import TextLine, legend_line, paste, text_line
from evs.msgs import Events
from evs.msgs.pictures import FAINT, PAPER, U8, event_frame

PANEL_PX = 480
"""Small sensors are enlarged by whole factors until the longer side has this many pixels."""

PLEASANT_ASPECT = 16 / 9
"""Panels stand side by side or on top of each other, whichever comes nearer to this shape."""


@dataclass(frozen=True)
class Shot:
    """One instant: the events of a window, and the light at its end if that is known."""

    end_us: int
    window_us: int
    events: Events
    """(n,) the window's events only"""
    background: U8 | None = None
    """(h, w) grey"""


def preview(
    shots: Sequence[Shot], width: int, height: int, title: str = "", scale: int | None = None
) -> U8:
    """Draw shots on one page.

    Args:
        shots: At least one.
        width: Sensor width, px.
        height: Sensor height, px.
        title: A line under the shots; empty: none.
        scale: Whole factor by which pixels are enlarged; None: by the sensor's size.

    Returns:
        (page height, page width, 3).
    """
    factor = scale or whole_factor(width, height, PANEL_PX)
    panel_width, panel_height = width * factor, height * factor
    size_px = font_size(panel_width)
    captions = [[text_line(words, size_px) for words in _caption(shot)] for shot in shots]
    gap = size_px
    # the cell is as wide as its widest line, so that no letter is cut on a narrow sensor
    cell_width = max(panel_width, *(line.width for lines in captions for line in lines))
    cell_height = panel_height + gap // 2 + sum(line.height for line in captions[0])
    columns, rows = _grid(len(shots), cell_width, cell_height)
    footer = _footer(title, size_px, columns * cell_width + (columns - 1) * gap)
    page_width = max(
        columns * cell_width + (columns + 1) * gap, 2 * gap + max(line.width for line in footer)
    )
    page_height = rows * (cell_height + gap) + 2 * gap + sum(line.height for line in footer)
    check_size(page_height, page_width)
    page = np.full((page_height, page_width, 3), PAPER, np.uint8)
    for index, (shot, lines) in enumerate(zip(shots, captions, strict=True)):
        left = gap + index % columns * (cell_width + gap) + (cell_width - panel_width) // 2
        top = gap + index // columns * (cell_height + gap)
        _panel(page, shot, width, height, factor, left, top)
        top += panel_height + gap // 2
        for line in lines:
            paste(page, line.picture, left - (cell_width - panel_width) // 2, top)
            top += line.height
    top = page_height - gap - sum(line.height for line in footer)
    for line in footer:
        paste(page, line.picture, gap, top)
        top += line.height
    return page


def shot_times(start_us: int, stop_us: int, count: int = 3) -> list[int]:
    """Instants that split a stretch evenly: a quarter, a half and three quarters of it, us.

    They are whole ms where the stretch is long enough for that.
    """
    step = (stop_us - start_us) / (count + 1)
    grid_us = 1000 if step >= 1000 else 1
    return [round((start_us + step * (index + 1)) / grid_us) * grid_us for index in range(count)]


def font_size(panel_width_px: int) -> int:
    """Height of the letters that belong to a panel of this width, px."""
    return min(48, max(14, panel_width_px // 26))


def _panel(page: U8, shot: Shot, width: int, height: int, factor: int, left: int, top: int) -> None:
    # a faint line around the panel: white sensors on a white page have an edge too
    page[top - 1 : top + height * factor + 1, left - 1 : left + width * factor + 1] = FAINT
    picture = event_frame(shot.events, width, height, shot.background)
    paste(page, upscale(picture, factor), left, top)


def _caption(shot: Shot) -> tuple[str, str]:
    on, off = count_polarities(shot.events)
    decimals = 6 if shot.end_us % 1000 else 3
    return (
        f"t = {shot.end_us / 1e6:.{decimals}f} s, the last {shot.window_us / 1e3:g} ms",
        f"{on + off:,} events: {on:,} ON, {off:,} OFF",
    )


def _footer(title: str, size_px: int, room_px: int) -> list[TextLine]:
    legend = legend_line(size_px)
    if not title:
        return [legend]
    words = text_line(title, size_px)
    if words.width + legend.width + 2 * size_px > room_px:
        return [words, legend]
    # both on one line, the legend at the right margin
    strip = np.full((legend.height, room_px, 3), PAPER, np.uint8)
    paste(strip, words.picture, 0, 0)
    paste(strip, legend.picture, room_px - legend.width, 0)
    return [TextLine(strip)]


def _grid(count: int, cell_width: int, cell_height: int) -> tuple[int, int]:
    """(columns, rows): all in a row or all in a column."""

    def strangeness(columns: int, rows: int) -> float:
        return abs(math.log(columns * cell_width / (rows * cell_height) / PLEASANT_ASPECT))

    return min((count, 1), (1, count), key=lambda grid: strangeness(*grid))
