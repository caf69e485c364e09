"""A moving picture of a recording: one frame after the other, the playback speed written in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from evs.drivers.pictures.frame import events_between, upscale, whole_factor
from evs.drivers.pictures.image_files import check_size
from evs.drivers.pictures.playback import Playback, speed_words
from evs.drivers.pictures.text_lines import TextLine, legend_line, paste, side_by_side, text_line
from evs.msgs import Events
from evs.msgs.pictures import FAINT, PAPER, U8, event_frame

CLIP_PX = 480
"""Small sensors are enlarged by whole factors until the longer side has this many pixels."""

Backgrounds = Callable[[int], U8 | None]
"""From a frame's end, us, to the light at that time: (h, w) grey, or None for paper white."""


def clip_frames(
    events: Events,
    width: int,
    height: int,
    playback: Playback,
    scale: int | None = None,
    background: Backgrounds | None = None,
) -> Iterator[U8]:
    """Draw the frames of a clip.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t.
        width: Sensor width, px.
        height: Sensor height, px.
        playback: Which time each frame shows.
        scale: Whole factor by which pixels are enlarged; None: by the sensor's size.
        background: The light behind the events.

    Yields:
        playback.frame_count pictures of one size: (page height, page width, 3), both even.
    """
    factor = scale or whole_factor(width, height, CLIP_PX)
    size_px = clip_font_size(width * factor)
    decimals = 3 if playback.step_us >= 1000 else 6
    # the words that never change are laid out once
    _, last_us = playback.frame_window(playback.frame_count - 1)
    clock_px = 1 + max(
        text_line(_clock(t_us, decimals), size_px).width for t_us in (last_us, 8 * last_us // 9)
    )
    begin_us, end_us = playback.frame_window(0)
    speed = text_line(
        f"{speed_words(playback.speed)}, {(end_us - begin_us) / 1e3:g} ms of events", size_px
    )
    legend = legend_line(size_px)
    margin = size_px // 2
    page_width = _even(
        max(width * factor, 2 * margin + max(clock_px + size_px + speed.width, legend.width))
    )
    page_height = _even(height * factor + margin + 2 * legend.height)
    check_size(page_height, page_width)
    for begin_us, end_us in playback.windows():
        page = np.full((page_height, page_width, 3), PAPER, np.uint8)
        shown = events_between(events, begin_us, end_us)
        picture = event_frame(shown, width, height, background(end_us) if background else None)
        paste(page, upscale(picture, factor), (page_width - width * factor) // 2, 0)
        clock = _padded(text_line(_clock(end_us, decimals), size_px), clock_px)
        # a faint line ends the picture where it is as white as the page
        page[height * factor] = FAINT
        top = height * factor + margin // 2
        paste(page, side_by_side(clock, speed, size_px).picture, margin, top)
        paste(page, legend.picture, margin, top + legend.height)
        yield page


def clip_font_size(panel_width_px: int) -> int:
    """Height of the letters under a panel of this width, px."""
    return min(40, max(13, panel_width_px // 34))


def _clock(t_us: int, decimals: int) -> str:
    return f"t = {t_us / 1e6:.{decimals}f} s"


def _padded(line: TextLine, width_px: int) -> TextLine:
    """`line` on a strip of constant width: what stands right of it must not tremble."""
    strip = np.full((line.height, max(width_px, line.width), 3), PAPER, np.uint8)
    paste(strip, line.picture, 0, 0)
    return TextLine(strip)


def _even(length: int) -> int:
    """The next even number: H.264 requires even sides."""
    return length + length % 2
