"""Compose the images of a GIF, panels side by side with a line of text, and write them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from evs.drivers.pictures import Playback, suffix_of, upscale, write_gif
from evs.drivers.pictures.text_lines import legend_line, paste, side_by_side, text_line
from evs.emulator import View
from evs.msgs import EventPacket, Events, EvsError, empty_events
from evs.msgs.pictures import FAINT, PAPER, U8, event_frame, to_srgb8

SIDE_PX = 128
"""side of the sensors of the examples"""
FACTOR = 2
"""how much larger they are shown"""
FPS = 25.0
GAP_PX = 8
LETTER_PX = 15
EXPOSURE = 0.9
"""of views of the scene"""


class RecentEvents:
    """The events of the last packets of each camera."""

    def __init__(self, packets: int) -> None:
        self._packets = packets
        self._recent: dict[str, list[Events]] = {}

    def update(self, packets: Sequence[EventPacket]) -> None:
        """Add packets and drop the oldest."""
        for packet in packets:
            recent = [*self._recent.get(packet.camera, []), packet.events]
            self._recent[packet.camera] = recent[-self._packets :]

    def panel(self, camera: str) -> U8:
        """(SIDE_PX FACTOR, SIDE_PX FACTOR, 3): the recent events of a camera, on paper."""
        events = np.concatenate([empty_events(), *self._recent.get(camera, [])])
        return upscale(event_frame(events, SIDE_PX, SIDE_PX), FACTOR)


def scene_panel(view: View) -> U8:
    """(h, w, 3): what a view of the scene shows now, in grey."""
    return np.repeat(to_srgb8(view.render()[0], EXPOSURE)[:, :, np.newaxis], 3, axis=2)


def compose_image(panels: Sequence[U8], words: str) -> U8:
    """Compose panels of one height in a row, framed, with a line of text and the legend below.

    Args:
        panels: (h, w, 3) each.
        words: the line of text.

    Returns:
        (h, w, 3).
    """
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
    """Raise an EvsError if the name does not end in .gif."""
    if suffix_of(path) != ".gif":
        raise EvsError(f"'{path}': end it in .gif")


def write_images(path: Path, images: Sequence[U8], speed: float = 1.0) -> None:
    """Write images as a GIF, FPS of them a second.

    Args:
        path: the file.
        images: (h, w, 3) each.
        speed: simulated seconds per second of the GIF.

    Raises:
        EvsError: there are no images.
    """
    if not images:
        raise EvsError("that is too short for a picture: give more --seconds")
    stop_us = round(len(images) * 1e6 * speed / FPS)
    write_gif(path, images, Playback(0, stop_us, fps=FPS, speed=speed))
