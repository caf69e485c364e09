"""Noise-adaptive running mean: the cheapest denoiser of light that is new in every tick.

Each pixel has a mean that follows its light, fast where the light really changes and slowly where
it is only noisy. Which of the two it is, two running statistics tell: how far tick and tick before
are apart (that is noise: light changes little in a millisecond) and how far, with its sign, light
and mean are apart (noise cancels out in it, a change does not). With N the mean square of the
first and b the mean of the second, the gain is that of a Kalman filter whose signal has the
variance b^2: b^2 / (b^2 + N). Fifteen additions, multiplications and divisions a pixel and tick,
in float32 and in this order: what is native one day has to give these bytes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.emulator.scene import F32

NOISE_GAIN = np.float32(1 / 32)
"""share of a tick in N: it remembers 32 ticks"""
DRIFT_GAIN = np.float32(1 / 16)
"""share of a tick in b: it remembers 16 ticks, and so much shorter a change looks like noise"""
LEAST_GAIN = np.float32(1 / 32)
"""the mean never remembers more than 32 ticks"""
TINY = np.float32(1e-20)
"""no 0 / 0 where the light has never changed"""


@dataclass(frozen=True)
class RunningMeanState:
    """Of each pixel (h, w) float32, in the light's unit (noise: its square)."""

    ticks: int
    light: F32
    mean: F32
    noise: F32
    drift: F32


def init(light: F32) -> RunningMeanState:
    """The state after the first tick, whose mean is its light."""
    zero = np.zeros_like(light)
    return RunningMeanState(1, light.copy(), light.copy(), zero, zero)


def step(light: F32, s: RunningMeanState) -> tuple[F32, RunningMeanState]:
    """One tick. In: light (h, w) float32, finite. Out: the mean, and the state after it."""
    # what has been seen for a few ticks only: the plain mean of them
    first = np.float32(1 / (s.ticks + 1))
    apart = light - s.light
    noise = s.noise + max(NOISE_GAIN, first) * (apart * apart - s.noise)
    off = light - s.mean
    drift = s.drift + DRIFT_GAIN * (off - s.drift)
    signal = drift * drift
    gain = np.maximum(signal / (signal + noise + TINY), max(LEAST_GAIN, first))
    mean = s.mean + gain * off
    return mean, RunningMeanState(s.ticks + 1, light.copy(), mean, noise, drift)


def running_mean(light: F32) -> F32:
    """(ticks, h, w) means of a film (ticks, h, w)."""
    state = init(light[0])
    means = [state.mean]
    for frame in light[1:]:
        mean, state = step(frame, state)
        means.append(mean)
    return np.stack(means)
