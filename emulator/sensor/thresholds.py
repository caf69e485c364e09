"""The fixed pattern: every pixel's own ON and OFF threshold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.emulator.scene import F32
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.random import Term, pixel_normals

FLOOR = 0.01
"""No threshold is lower (v2e's floor); over 2^-8, so that the pixel's arithmetic is exact."""


@dataclass(frozen=True)
class Thresholds:
    """Thresholds in log units. They follow from sensor and seed, so they are no state."""

    on: F32
    """(h, w)"""
    off: F32
    """(h, w)"""


def draw_thresholds(sensor: SensorParameters, seed: int) -> Thresholds:
    """theta = max(FLOOR, mean + sigma N), N standard normal per pixel and polarity."""

    def pattern(mean: float, term: Term) -> F32:
        normals = pixel_normals(seed, term, sensor.width, sensor.height)
        theta = np.maximum(FLOOR, mean + sensor.sigma_thres * normals).astype(np.float32)
        theta.flags.writeable = False
        return theta

    return Thresholds(
        on=pattern(sensor.pos_thres, Term.THRESHOLD_ON),
        off=pattern(sensor.neg_thres, Term.THRESHOLD_OFF),
    )
