"""Light that is known at every instant: each pixel's log light is a sum of two sines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.msgs import Events, join_events

MIDDLE = 4.0
"""the mean of log light, ln DN"""


@dataclass(frozen=True)
class Waves:
    """Waves on (h, w) pixels: log light is MIDDLE + sum of amplitude sin(2 pi rate t + phase)."""

    rate_hz: F64
    """(2, h, w)"""
    amplitude: F64
    """(2, h, w), log units"""
    phase: F64
    """(2, h, w)"""

    @classmethod
    def of(cls, side: int, fastest_hz: float, seed: int, whole: bool = False) -> Waves:
        """Make random waves on a square sensor.

        Args:
            side: The side of the sensor, px.
            fastest_hz: The highest rate.
            seed: The seed of the random numbers.
            whole: Whether rates are rounded up to whole numbers, so that a second is a period.
        """
        rng = np.random.default_rng(seed)
        shape = (2, side, side)
        rate = rng.uniform(0.5, fastest_hz, shape)
        if whole:
            rate = np.ceil(rate)
        return cls(rate, rng.uniform(0.3, 1.0, shape), rng.uniform(0, 2 * np.pi, shape))

    def log(self, t_us: float) -> F64:
        """Return log light at a time, (h, w), ln DN."""
        angle = 2 * np.pi * self.rate_hz * (t_us * 1e-6) + self.phase
        return np.asarray(MIDDLE + (self.amplitude * np.sin(angle)).sum(axis=0))

    def luminance(self, t_us: float) -> F32:
        """Return luminance at a time for a sensor with exposure_dn = 1, (h, w)."""
        return np.exp(self.log(t_us)).astype(np.float32)


def run(
    sensor: SensorParameters,
    light: Callable[[float], F32],
    tick_us: int,
    end_us: int,
    seed: int = 0,
) -> Events:
    """Return the events of (0, end_us] with ticks of `tick_us`; light(0) sets the references."""
    model = PlainModel(sensor, 1)
    # a first tick of 1 us: the sensor's own clock begins at the same time, whatever tick_us is
    _, state = model.step(light(0), model.init(seed), -1, 0)
    parts = []
    for t_us in range(tick_us, end_us + 1, tick_us):
        events, state = model.step(light(t_us), state, t_us - tick_us, t_us)
        parts.append(events)
    return join_events(parts)
