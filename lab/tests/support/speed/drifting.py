"""A film for event pixels: a soft random texture that drifts, and eventcv on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Film = np.ndarray[Any, np.dtype[np.float32]]

PX_PER_FRAME = 0.15
GRAIN_PX = 4
"""distance of the texture's random points"""


def film(width: int, height: int, frames: int) -> Film:
    """(frames, height, width) linear light in [0, 1]: 8 events a frame for 100 pixels."""
    random = np.random.default_rng(0)
    columns = (width + round(PX_PER_FRAME * frames)) // GRAIN_PX + 2
    texture = random.standard_normal((height // GRAIN_PX + 2, columns))
    y = np.arange(height) / GRAIN_PX
    texture = _between(texture, y, 0)
    light = [
        np.exp(-1.5 + 0.6 * _between(texture, (np.arange(width) + PX_PER_FRAME * k) / GRAIN_PX, 1))
        for k in range(frames)
    ]
    return np.clip(light, 0, 1).astype(np.float32)


def _between(texture: np.ndarray[Any, Any], places: Any, axis: int) -> np.ndarray[Any, Any]:
    """Linear interpolation along an axis."""
    whole = places.astype(int)
    share = np.expand_dims(places - whole, 1 - axis)
    near, far = (np.take(texture, whole + k, axis) for k in (0, 1))
    return np.asarray(near * (1 - share) + far * share)


def eventcv(width: int, height: int, frames: int, options: dict[str, Any]) -> Callable[[], int]:
    """Simulates the film with eventcv; how many events that gives. For a process of its own."""
    import eventcv

    light = film(width, height, frames)
    # eventcv decodes sRGB
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    coded = coded.astype(np.float32)
    return lambda: len(eventcv.simulate(coded, fps=1000, **options))
