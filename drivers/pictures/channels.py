"""One picture of a rendered frame: a panel for each channel, in its own colours."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.pictures.frame import upscale, whole_factor
from evs.drivers.pictures.preview import font_size
from evs.drivers.pictures.text_lines import paste, text_line
from evs.msgs.pictures import FAINT, PAPER, U8, exposure_for, to_srgb8

PANEL_PX = 320
"""Small frames are enlarged by whole factors until the longer side has this many pixels."""

Values = npt.NDArray[Any]

NOTHING = 232
"""Grey of missing values: infinite, NaN, id -1."""


def channel_page(frame: Mapping[str, Values]) -> U8:
    """Draw the channels of a frame as panels in columns, each with its caption.

    Args:
        frame: Name -> (h, w, ...) values; other shapes are left out, and at least one must remain.

    Returns:
        (height, width, 3).
    """
    panels = {name: panel(name, np.asarray(value)) for name, value in frame.items()
              if np.ndim(value) > 1}  # fmt: skip
    height, width = next(iter(panels.values()))[0].shape[:2]
    factor = whole_factor(width, height, PANEL_PX)
    width, height = width * factor, height * factor
    size_px = font_size(width)
    captions = [text_line(words, size_px) for _, words in panels.values()]
    columns = min(len(panels), math.ceil(math.sqrt(len(panels))))
    rows = -(-len(panels) // columns)
    cell_width = max(width, *(line.width for line in captions)) + size_px
    cell_height = height + captions[0].height + size_px
    page = np.full(
        (rows * cell_height + size_px, columns * cell_width + size_px, 3), PAPER, np.uint8
    )
    for index, ((picture, _), caption) in enumerate(zip(panels.values(), captions, strict=True)):
        left = size_px + index % columns * cell_width
        top = size_px + index // columns * cell_height
        page[top - 1 : top + height + 1, left - 1 : left + width + 1] = FAINT
        paste(page, upscale(picture, factor), left, top)
        paste(page, caption.picture, left, top + height)
    return page


def panel(name: str, value: Values) -> tuple[U8, str]:
    """A channel in colour, (h, w, 3), and its caption; events are a picture already."""
    if name == "events":
        return np.asarray(value, np.uint8), "events until then: ON blue, OFF red"
    if name in ("luminance", "rgb"):
        coded = to_srgb8(value, exposure_for(value))
        return _three(coded), name
    if name in ("depth", "distance"):
        return _nearness(name, value)
    if name == "normal":
        return _coloured(0.5 + 0.5 * value), "normal: x, y, z as red, green, blue"
    if name == "position":
        # a floor at z = 0 stays on one side
        value = np.where(np.isfinite(value), value, np.nan) + 1e-3
        return _coloured(np.mod(value, 1.0)), "position: x, y, z within 1 m as red, green, blue"
    if name == "flow":
        return _wheel(value)
    found = len(np.unique(value[value != -1]))
    return _by_number(value), f"{name}: {found} of them"


def _nearness(name: str, value: Values) -> tuple[U8, str]:
    """Distances as grey: near is dark, and the 98th percentile is the far end."""
    valid = np.isfinite(value)
    if not valid.any():
        return np.full((*value.shape, 3), NOTHING, np.uint8), f"{name}: nothing there"
    near, far = float(value[valid].min()), float(np.quantile(value[valid], 0.98))
    clipped = np.clip(np.where(valid, value, far), near, far)
    share = (clipped - near) / max(far - near, 1e-30)
    grey = np.where(valid, 20 + 190 * share, NOTHING).astype(np.uint8)
    return _three(grey), f"{name}: {near:.3g} ... {far:.3g} m"


def _coloured(share: Values) -> U8:
    """(h, w, 3) numbers 0 ... 1 as colours; NaN is a missing value."""
    valid = np.all(np.isfinite(share), -1, keepdims=True)
    return np.where(valid, 255 * np.clip(np.nan_to_num(share), 0, 1), NOTHING).astype(np.uint8)


def _wheel(flow: Values) -> tuple[U8, str]:
    """Motion as colours: hue is the direction, saturation the speed; still is white."""
    valid = np.all(np.isfinite(flow), -1)
    flow = np.where(valid[..., np.newaxis], flow, 0.0).astype(np.float64)
    speed = np.hypot(flow[..., 0], flow[..., 1])
    most = float(np.quantile(speed[valid], 0.995)) if valid.any() else 0.0
    most = most or float(speed.max())
    share = np.clip(speed / most, 0, 1)[..., np.newaxis] if most else np.zeros((*speed.shape, 1))
    angle = np.arctan2(-flow[..., 1], flow[..., 0])[..., np.newaxis]
    third = 2 * np.pi / 3
    hue = 0.5 + 0.5 * np.cos(angle - np.array([0.0, third, 2 * third]))
    coded = 255 * (1 - share * (1 - hue))
    shown = np.where(valid[..., np.newaxis], coded, NOTHING).astype(np.uint8)
    return shown, f"flow: up to {most:.3g} px/s; red: right"


def _by_number(ids: Values) -> U8:
    """A fixed colour for each id; the golden ratio separates consecutive ids."""
    numbers, places = np.unique(ids, return_inverse=True)
    colours = [
        (NOTHING,) * 3 if number == -1
        else tuple(255 * part for part in colorsys.hsv_to_rgb(number * 0.618034 % 1, 0.6, 0.85))
        for number in numbers.tolist()
    ]  # fmt: skip
    return np.array(colours).astype(np.uint8)[places.reshape(ids.shape)]


def _three(grey: U8) -> U8:
    return grey if grey.ndim == 3 else np.repeat(grey[:, :, np.newaxis], 3, axis=2)
