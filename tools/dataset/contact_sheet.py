"""Contact sheets: all channels of a scene at one moment, and a row for each scene of a set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.pictures import channel_page
from evs.drivers.pictures.channels import panel
from evs.drivers.pictures.text_lines import paste, text_line
from evs.msgs.pictures import PAPER, U8, event_frame
from evs.tools.dataset.reader import RecordedSequence

WINDOW_US = 20_000
"""duration of the events that are shown"""
CHANNELS = ("rgb", "events", "depth", "normal", "flow", "geom_id")
ROW = ("rgb", "events", "depth", "flow", "geom_id")
SIZE_PX = 13
"""height of the letters"""
ROW_PX = 230
"""of the widest panel in a row of a set's sheet"""

Frame = Mapping[str, npt.NDArray[Any]]


def moment(scene: RecordedSequence, share: float = 0.6) -> dict[str, npt.NDArray[Any]]:
    """The channels of one frame, and the events of WINDOW_US before it as an image.

    Args:
        scene: the recorded scene.
        share: of the scene's time; never the first frame, which has no events before it.
    """
    index = min(max(1, round(share * scene.frame_count)), scene.frame_count - 1)
    frame = dict(scene.frame(index))
    end_us = int(frame["t_us"])
    events = scene.events(end_us - WINDOW_US, end_us)
    height, width = frame["depth"].shape
    frame["events"] = event_frame(events.array, width, height)
    return frame


def scene_page(scene: RecordedSequence) -> U8:
    """(h, w, 3): one moment of a scene, every channel with its caption."""
    frame = moment(scene)
    page = channel_page({name: frame[name] for name in CHANNELS})
    return _with_words(page, words_of(_values_of(scene)), SIZE_PX)


def _values_of(scene: RecordedSequence) -> dict[str, float]:
    return {**scene.sensor_values, **scene.scene_values}


def words_of(values: Mapping[str, float]) -> str:
    """The values of a randomised sensor and scene, for people."""
    return ", ".join(f"{key} {value:g}" for key, value in values.items())


def set_page(scenes: Iterable[RecordedSequence]) -> U8:
    """(h, w, 3): a row for each scene: RGB, events, depth, flow, segmentation."""
    rows = []
    for scene in scenes:
        frame = moment(scene)
        pictures = [panel(name, np.asarray(frame[name]))[0] for name in ROW]
        step = max(1, pictures[0].shape[1] // ROW_PX)
        values = words_of(_values_of(scene))
        named = f"{scene.name}: {values}" if values else scene.name
        rows.append((named, [_smaller(picture, step) for picture in pictures]))
    height, width = rows[0][1][0].shape[:2]
    gap, size_px = 4, SIZE_PX
    label = text_line("M", size_px).height
    page = np.full(
        (len(rows) * (height + label + gap), len(ROW) * (width + gap) + gap, 3), PAPER, np.uint8
    )
    for row, (name, pictures) in enumerate(rows):
        top = row * (height + label + gap)
        words = text_line(name, size_px).picture
        paste(page, words[:, : page.shape[1] - gap], gap, top)
        for column, picture in enumerate(pictures):
            paste(page, picture, gap + column * (width + gap), top + label)
    return page


def _with_words(page: U8, text: str, size_px: int) -> U8:
    """The page with lines of text below it, broken at commas."""
    lines: list[str] = []
    for part in text.split(", ") if text else ():
        longer = f"{lines[-1]}, {part}" if lines else part
        if lines and text_line(longer, size_px).width <= page.shape[1] - 2 * size_px:
            lines[-1] = longer
        else:
            lines.append(part)
    strips = [page]
    for line in lines:
        words = text_line(line, size_px).picture[:, : page.shape[1] - size_px]
        strip = np.full((words.shape[0], page.shape[1], 3), PAPER, np.uint8)
        paste(strip, words, size_px, 0)
        strips.append(strip)
    return np.concatenate(strips)


def _smaller(picture: U8, step: int) -> U8:
    """Mean of each step x step pixels; incomplete blocks at the right and bottom are cut."""
    height, width = (side // step * step for side in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // step, step, width // step, step, 3)
    return np.asarray(np.rint(blocks.mean((1, 3))), np.uint8)
