"""The colours of every picture: one pair for the two polarities, grey for everything else.

Linear light becomes what a screen shows: one exposure, then the sRGB curve, 8 bits.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

U8 = npt.NDArray[np.uint8]
"""Pictures are uint8: (h, w) grey or (h, w, 3) sRGB."""

ON_RGB = (0, 114, 255)
"""Blue: the light grew. The field uses blue and red; this pair differs in hue, in lightness and
along the axis that every kind of colour blindness leaves (yellow-blue, or dark-light)."""

OFF_RGB = (224, 48, 16)
"""Red with a little orange: the light fell."""

PAPER = 255
"""Grey of the page, and of pixels without light or events."""

INK = 24
"""Grey of letters."""

FAINT = 208
"""Grey of the line around a panel."""


BRIGHT_SHARE = 0.99
"""This share of the pixels is not brighter than BRIGHT_LEVEL after exposure."""

BRIGHT_LEVEL = 0.8
"""Linear display light of the BRIGHT_SHARE quantile: a little room is left for highlights."""


def exposure_for(luminance: npt.NDArray[np.float32]) -> float:
    """The factor that brings a picture's bright parts near white.

    Args:
        luminance: (h, w) linear, in any unit; NaN, Inf and negative values are ignored.

    Returns:
        A factor above 0; 1.0 for a picture without any light, so that black stays black.
    """
    valid = luminance[np.isfinite(luminance) & (luminance > 0)]
    if not valid.size:
        return 1.0
    bright = float(np.quantile(valid, BRIGHT_SHARE))
    return BRIGHT_LEVEL / bright if bright > 0 else 1.0


def to_srgb8(luminance: npt.NDArray[np.float32], exposure: float) -> U8:
    """Code linear luminance as sRGB grey (IEC 61966-2-1).

    Args:
        luminance: (h, w) linear; NaN and negative light is black, +Inf is white.
        exposure: Factor; the product is white from 1.0 on.

    Returns:
        (h, w) uint8.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = luminance.astype(np.float64) * exposure
    light = np.clip(np.nan_to_num(scaled, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * coded).astype(np.uint8)
