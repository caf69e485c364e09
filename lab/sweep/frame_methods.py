"""The methods of v2e and ESIM: images at a frame rate, then events from images.

Our `plain` pixel replaces theirs, so that only the method is compared, not the pixel:

- ESIM finds exact crossing times under log light that is linear between two pictures. That is what
  `plain` does inside a tick, so its method is `plain` with ticks as long as the time between
  pictures.
- v2e first makes more pictures between two that there are (SuperSloMo). Linear interpolation of the
  light stands in for that network, one picture a ms, and a pixel that steps from each to the next.
  Its films have 8 bits a pixel, mostly coded as sRGB; both codes are available.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import F32
from evs.msgs import EvsError

UPSAMPLED_US = 1000
"""from one picture to the next behind v2e's interpolation"""

WHITE_DN = 255.0


@dataclass(frozen=True)
class FrameMethod:
    """How frames become events."""

    upsampled: bool
    """v2e: pictures between pictures; else ESIM"""
    code: str = ""
    """of a pixel: "" float, "8 bit" linear, "8 bit sRGB" """


def frame_method(value: str) -> FrameMethod:
    """The method that a value of the axis `frames` names, as in `v2e, 250 FPS, 8 bit`."""
    name, _, rest = value.partition(", ")
    code = rest.partition(", ")[2]
    if name not in ("ESIM", "v2e") or code not in ("", "8 bit", "8 bit sRGB"):
        raise EvsError(f"'{value}' is no way of frames; the axis `frames` has them all")
    return FrameMethod(name == "v2e", code)


def quantise(light: F32, code: str) -> F32:
    """Quantise light to 8 bits, in units of white; without a code it stays as it is.

    Values coded as sRGB are not decoded: like v2e, they are taken for light.
    """
    if not code:
        return light
    shown = np.clip(light, 0.0, 1.0)
    if code == "8 bit sRGB":
        low = shown <= 0.0031308
        shown = np.where(low, 12.92 * shown, 1.055 * np.maximum(shown, 1e-9) ** (1 / 2.4) - 0.055)
    return (np.round(shown * np.float32(WHITE_DN)) / np.float32(WHITE_DN)).astype(np.float32)


def interpolate(first: F32, second: F32, begin_us: int, end_us: int) -> list[tuple[int, F32]]:
    """Interpolate pictures at each multiple of 1 ms in (begin_us, end_us], and at end_us itself.

    The interpolation is linear in the light, as a blend of two frames is.

    Args:
        first: picture at begin_us.
        second: picture at end_us.
        begin_us: time of the first picture.
        end_us: time of the second picture.

    Returns:
        (t_us, picture) of each.
    """
    step = UPSAMPLED_US
    times = [*range(begin_us // step * step + step, end_us, step), end_us]
    shares = [np.float32((t - begin_us) / (end_us - begin_us)) for t in times]
    return [
        (t, second if t == end_us else first + (second - first) * share)
        for t, share in zip(times, shares, strict=True)
    ]
