"""The numbers of a model that shape light, brought into the ranges that MuJoCo gives them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError

BRIGHTEST = 1e9
"""No light, and nothing that glows, is brighter: the sun is 1e5 lux."""


def clamped(value: float, low: float, high: float, what: str) -> float:
    """Clamp a number of the model, as MuJoCo's viewer clamps colours in the end.

    Args:
        value: Any number, as MuJoCo takes it.
        low: The lowest result.
        high: The highest result.
        what: The name of the value and of what has it, for messages.

    Raises:
        EvsError: It is not finite.
    """
    number = float(value)
    if not math.isfinite(number):
        raise EvsError(f"{what} is {number}; give a number in {low:g} ... {high:g}")
    return min(max(number, low), high)


def clamped_colour(values: npt.ArrayLike, high: float, what: str) -> tuple[float, float, float]:
    """Three of them, 0 ... high."""
    red, green, blue = np.asarray(values, np.float64)
    return (
        clamped(red, 0.0, high, what),
        clamped(green, 0.0, high, what),
        clamped(blue, 0.0, high, what),
    )
