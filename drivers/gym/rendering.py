"""The picture of `render`: the scene, and the events of each camera in the last step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evs.drivers.pictures import U8, event_frame, exposure_for, to_srgb8, upscale
from evs.emulator import View
from evs.msgs import Events

SCENE_PX = (480, 360)
"""width, height of the scene in the picture, px"""


def draw(scene: View, seen: Sequence[tuple[Events, int, int]]) -> U8:
    """Draw the scene and the events next to each other.

    Args:
        scene: A view of the scene in colour.
        seen: (events, width, height) of each camera.

    Returns:
        (h, w, 3) uint8 sRGB.
    """
    luminance, rgb = scene.render()
    left = to_srgb8(luminance if rgb is None else rgb, exposure_for(luminance))
    if left.ndim == 2:
        left = np.repeat(left[:, :, np.newaxis], 3, axis=2)
    panels = [_panel(event_frame(*one), left.shape[0]) for one in seen]
    return np.concatenate([left, *panels], axis=1)


def _panel(picture: U8, height_px: int) -> U8:
    """The picture, enlarged by a whole factor, in the middle of a strip of this height."""
    factor = max(1, height_px // picture.shape[0])
    # skip rows and columns of a sensor that is taller than the strip
    step = -(-picture.shape[0] // height_px)
    enlarged = upscale(picture[::step, ::step], factor)
    strip = np.zeros((height_px, enlarged.shape[1], 3), np.uint8)
    top = (height_px - enlarged.shape[0]) // 2
    strip[top : top + enlarged.shape[0]] = enlarged
    return strip
