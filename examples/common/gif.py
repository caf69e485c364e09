"""Compose the images of a GIF: panels side by side with a line of text, and write them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from evs.drivers.pictures import U8, Playback, event_frame, suffix_of, upscale, write_gif
from evs.drivers.pictures.colours import FAINT, PAPER
from evs.drivers.pictures.text_lines import legend_line, paste, side_by_side, text_line
from evs.msgs import EventPacket, Events, EvsError, empty_events

SIDE_PX = 128
"""Of the sensors of the loops."""
FACTOR = 2
"""How much larger they are shown."""
FPS = 25.0
GAP_PX = 8
LETTER_PX = 15
EXPOSURE = 0.9
"""Of views of the scene."""


class RecentEvents:
    """The events of the last packets of each camera."""

    def __init__(self, packets: int) -> None:
        self._packets = packets
        self._kept: dict[str, list[Events]] = {}

    def update(self, packets: Sequence[EventPacket]) -> None:
        """Add packets and drop the oldest."""
        for packet in packets:
            kept = [*self._kept.get(packet.camera, []), packet.events]
            self._kept[packet.camera] = kept[-self._packets :]

    def panel(self, camera: str) -> U8:
        """(SIDE_PX FACTOR, same, 3): what is kept of a camera, on paper."""
        events = np.concatenate([empty_events(), *self._kept.get(camera, [])])
        return upscale(event_frame(events, SIDE_PX, SIDE_PX), FACTOR)


def compose_image(panels: Sequence[U8], words: str) -> U8:
    """Panels of one height in a row, framed; words and the legend of events below."""
    side = panels[0].shape[0]
    below = side_by_side(text_line(words, LETTER_PX), legend_line(LETTER_PX), 2 * LETTER_PX)
    row = sum(panel.shape[1] + GAP_PX for panel in panels) - GAP_PX
    sheet = np.full(
        (side + below.height + 3 * GAP_PX, max(row, below.width) + 2 * GAP_PX, 3), PAPER, np.uint8
    )
    left = GAP_PX
    for panel in panels:
        sheet[GAP_PX - 1 : GAP_PX + side + 1, left - 1 : left + panel.shape[1] + 1] = FAINT
        paste(sheet, panel, left, GAP_PX)
        left += panel.shape[1] + GAP_PX
    paste(sheet, below.picture, GAP_PX, side + 2 * GAP_PX)
    return sheet


def check_gif_name(path: Path) -> None:
    """EvsError where the name is not that of a GIF."""
    if suffix_of(path) != ".gif":
        raise EvsError(f"'{path}': end it in .gif")


def write_images(path: Path, images: Sequence[U8], speed: float = 1.0) -> None:
    """Pages, one each FPS-th second of the viewer's time, as a GIF.

    Args:
        path: the file.
        images: (h, w, 3) each.
        speed: of what is shown.
    """
    if not images:
        raise EvsError("that is too short for a picture: give more --seconds")
    stop_us = round(len(images) * 1e6 * speed / FPS)
    write_gif(path, images, Playback(0, stop_us, fps=FPS, speed=speed))
