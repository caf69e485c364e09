"""Contact sheets: all channels of a scene at one moment, and a row for each scene of a set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.pictures import U8, channel_page, event_frame
from evs.drivers.pictures.channels import panel
from evs.drivers.pictures.colours import PAPER
from evs.drivers.pictures.text_lines import paste, text_line
from evs.tools.dataset.reader import RecordedSequence

WINDOW_US = 20_000
"""duration of the events that are shown"""
CHANNELS = ("rgb", "events", "depth", "normal", "flow", "geom_id")
ROW = ("rgb", "events", "depth", "flow", "geom_id")
ROW_PX = 230
"""of the widest panel in a row of a set's sheet"""

Frame = Mapping[str, npt.NDArray[Any]]


def moment(scene: RecordedSequence, share: float = 0.6) -> dict[str, npt.NDArray[Any]]:
    """The channels of one frame, and the events of WINDOW_US before it as an image.

    Args:
        scene: the recorded scene.
        share: of the scene's time; never the first frame, which has no events before it.
    """
    place = min(max(1, round(share * scene.frame_count)), scene.frame_count - 1)
    frame = dict(scene.frame(place))
    end_us = int(frame["t_us"])
    events = scene.events(end_us - WINDOW_US, end_us)
    height, width = frame["depth"].shape
    frame["events"] = event_frame(events.array, width, height)
    return frame


def scene_page(scene: RecordedSequence) -> U8:
    """(h, w, 3): one moment of a scene, every channel with its caption."""
    frame = moment(scene)
    return channel_page({name: frame[name] for name in CHANNELS})


def set_page(scenes: Iterable[RecordedSequence]) -> U8:
    """(h, w, 3): a row for each scene: RGB, events, depth, flow, segmentation."""
    rows = []
    for scene in scenes:
        frame = moment(scene)
        pictures = [panel(name, np.asarray(frame[name]))[0] for name in ROW]
        step = max(1, pictures[0].shape[1] // ROW_PX)
        rows.append((scene.name, [_smaller(picture, step) for picture in pictures]))
    height, width = rows[0][1][0].shape[:2]
    gap, size_px = 4, 13
    label = text_line("M", size_px).height
    page = np.full(
        (len(rows) * (height + label + gap), len(ROW) * (width + gap) + gap, 3), PAPER, np.uint8
    )
    for row, (name, pictures) in enumerate(rows):
        top = row * (height + label + gap)
        paste(page, text_line(name, size_px).picture, gap, top)
        for column, picture in enumerate(pictures):
            paste(page, picture, gap + column * (width + gap), top + label)
    return page


def _smaller(picture: U8, step: int) -> U8:
    """Mean of each step x step pixels; incomplete blocks at the right and bottom are cut."""
    height, width = (side // step * step for side in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // step, step, width // step, step, 3)
    return np.asarray(np.rint(blocks.mean((1, 3))), np.uint8)
