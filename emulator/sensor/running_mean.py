"""Noise-adaptive running mean: the cheapest denoiser of light that is new in every tick.

Each pixel has a mean that follows its light, fast where the light really changes and slowly where
it is only noisy. Two running statistics decide which of the two it is: how far tick and tick before
are apart (that is noise: light changes little in a millisecond) and how far, with its sign, light
and mean are apart (noise cancels out in it, a change does not). With N the mean square of the
first and b the mean of the second,

    N    += noise_gain ((light - light before)^2 - N)
    b    += drift_gain ((light - mean) - b)
    mean += max(b^2 / (b^2 + noise_weight N), least_gain) (light - mean)

whose gain is that of a Kalman filter for a signal of variance b^2. All of it in linear light,
before the log. In the first ticks the gains of N and of the mean are at least 1 / ticks, so that
they are the plain means of what has been seen.

This is the oracle of the event model `adaptive`: sixteen float32 additions, multiplications and
divisions a pixel and tick, in this order, none fused. No denormal outlives a tick and no square
overflows, so the bytes do not depend on whether a thread flushes denormals.
lab/docs/evidence/pixel.md describes how the constants were fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from evs.emulator.base.scene import F32
from evs.msgs import EvsError

BLACK = np.float32(2.0**-64)
"""light and means closer to 0 are 0, as in the pixel (core/sensor/log_map.h)"""
LARGEST_LIGHT = np.float32(2.0**60)
"""more is no light: its square must stay a float"""
LEAST_DRIFT = np.float32(2.0**-50)
"""a drift closer to 0 is 0: its square must stay a normal float"""
LEAST_NOISE = np.float32(2.0**-100)
"""less is 0"""
TINY = np.float32(2.0**-100)
"""no 0 / 0 where the light has never changed"""

_RANGES = {
    "noise_gain": (2.0**-20, 1.0),
    "drift_gain": (2.0**-20, 1.0),
    "least_gain": (2.0**-20, 1.0),
    "noise_weight": (2.0**-20, 64.0),
}


@dataclass(frozen=True)
class RunningMeanConstants:
    """Fitted for ticks of 1 ms. Used as float32. Raises EvsError for values without sense."""

    noise_gain: float = 1 / 64
    """share of a tick in N, which so remembers 1 / noise_gain ticks"""
    drift_gain: float = 1 / 16
    """share of a tick in b; what lasts for less than 1 / drift_gain ticks passes for noise"""
    least_gain: float = 1 / 64
    """share of a tick in the mean, at least: it remembers 1 / least_gain ticks at most"""
    noise_weight: float = 2.0
    """how much noise counts against drift: more is calmer, and later"""

    def __post_init__(self) -> None:
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), _RANGES[field.name]
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise EvsError(f"running mean: {field.name} is {value!r}; give a number")
            if not low <= value <= high:  # also where it is NaN
                raise EvsError(
                    f"running mean: {field.name} is {value:g}; give {low:g} ... {high:g}"
                )


@dataclass(frozen=True)
class RunningMeanState:
    """What the mean remembers of each pixel. A value: no step changes it."""

    ticks: int
    """ticks seen by the whole frame, whatever light they had"""
    clamped: int
    """pixels times ticks whose light was none (negative, NaN, over LARGEST_LIGHT) and was replaced
    by the last one"""
    light: F32
    """(h, w) the last light"""
    mean: F32
    """(h, w), in the light's unit; NaN before a pixel's first light"""
    noise: F32
    """(h, w) N, in the light's unit squared"""
    drift: F32
    """(h, w) b, in the light's unit"""


def dark(height: int, width: int) -> RunningMeanState:
    """The state before the first tick."""
    zero = np.zeros((height, width), np.float32)
    return RunningMeanState(0, 0, zero, np.full_like(zero, np.nan), zero, zero)


def step(
    light: F32, s: RunningMeanState, c: RunningMeanConstants | None = None
) -> tuple[F32, RunningMeanState]:
    """Step the running mean by one tick.

    Args:
        light: (h, w) float32, linear.
        s: The state before.
        c: The constants; None: the defaults.

    Returns:
        The means (h, w), and the state after the tick. A pixel's first light is its mean; until
        then its mean is NaN.
    """
    c = RunningMeanConstants() if c is None else c
    usable = (light > -BLACK) & (light <= LARGEST_LIGHT)  # False for NaN
    light = np.where(usable, _flush(light, BLACK), s.light)

    # what has been seen for a few ticks only: the plain mean of them
    first = np.float32(1 / (s.ticks + 1))
    noise_gain = max(np.float32(c.noise_gain), first)
    least_gain = max(np.float32(c.least_gain), first)

    apart = light - s.light
    noise = s.noise + noise_gain * (apart * apart - s.noise)
    noise = _flush(noise, LEAST_NOISE)
    off = light - s.mean
    drift = s.drift + np.float32(c.drift_gain) * (off - s.drift)
    drift = _flush(drift, LEAST_DRIFT)
    signal = drift * drift
    gain = signal / (signal + np.float32(c.noise_weight) * noise + TINY)
    mean = _flush(s.mean + np.maximum(gain, least_gain) * off, BLACK)

    # the first light is the mean, and nothing is known of its noise
    new = np.isnan(s.mean)
    mean = np.where(new, np.where(usable, light, s.mean), mean)
    noise, drift = (np.where(new, np.float32(0), part) for part in (noise, drift))
    clamped = s.clamped + int(np.count_nonzero(~usable))
    return mean, RunningMeanState(s.ticks + 1, clamped, light, mean, noise, drift)


def running_mean(light: F32, constants: RunningMeanConstants | None = None) -> F32:
    """(ticks, h, w) means of a film (ticks, h, w)."""
    state, means = dark(*light.shape[1:]), []
    for frame in light:
        mean, state = step(frame, state, constants)
        means.append(mean)
    return np.stack(means)


def _flush(value: F32, least: np.float32) -> F32:
    """0 where closer to 0 than `least`; a NaN stays."""
    return np.where(np.abs(value) < least, np.float32(0), value)
