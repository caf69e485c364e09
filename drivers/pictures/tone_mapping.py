"""Linear luminance to what a screen shows: one exposure, then the sRGB curve, 8 bits."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.drivers.pictures.colours import U8

BRIGHT_SHARE = 0.99
"""This share of the pixels is not brighter than BRIGHT_LEVEL after exposure."""

BRIGHT_LEVEL = 0.8
"""Linear display light of the BRIGHT_SHARE quantile: a little room is left for highlights."""


def exposure_for(luminance: npt.NDArray[np.float32]) -> float:
    """The factor that brings a picture's bright parts near white.

    In: luminance (h, w) linear, any unit. NaN, Inf and negative values do not count.
    Out: > 0; 1.0 for a picture without any light, so that black stays black.
    """
    valid = luminance[np.isfinite(luminance) & (luminance > 0)]
    if not valid.size:
        return 1.0
    bright = float(np.quantile(valid, BRIGHT_SHARE))
    return BRIGHT_LEVEL / bright if bright > 0 else 1.0


def to_srgb8(luminance: npt.NDArray[np.float32], exposure: float) -> U8:
    """(h, w) linear luminance times `exposure` as (h, w) uint8 sRGB grey; 1.0 and above is 255.

    NaN and negative light is black, +Inf is white. Curve: IEC 61966-2-1.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = luminance.astype(np.float64) * exposure
    light = np.clip(np.nan_to_num(scaled, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * coded).astype(np.uint8)
