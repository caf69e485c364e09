"""A slow oracle of photon noise: the noise itself in fine steps, and what events tell of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.parameters import ELECTRON_C
from evs.emulator.sensor.pixel import PlainState
from evs.msgs import EVENT_DTYPE, Events, join_events

DARK_LUX = 1.0
WHITE_LUX = 1000.0


def noisy_sensor(
    poles_hz: tuple[float, float],
    sigma: float,
    theta: float,
    side: int,
    **more: Any,
) -> SensorParameters:
    """Make a sensor whose noise has this deviation and these poles at a luminance of 1.

    Args:
        poles_hz: Bandwidth of photoreceptor and of source follower, Hz; one of them may be 0.
        sigma: Standard deviation of the noise, log units.
        theta: Both thresholds, log units.
        side: The side of the sensor, px.
        more: Other parameters of the sensor.
    """
    w = [2 * math.pi * 1e-6 * f for f in poles_hz if f > 0]
    band = math.prod(w) / sum(w) if len(w) == 2 else w[0]
    factor = 2.0
    dark_lux = more.setdefault("dark_lux", DARK_LUX)
    dn = 255.0 * (1.0 + dark_lux / WHITE_LUX)
    electrons_per_us_dn = 2.0 * factor / 4.0 * band / dn / sigma**2
    # electrons in a us at 255 DN, which is bright_lux, as pA
    photocurrent_pa = electrons_per_us_dn * 255.0 * 1e6 * ELECTRON_C * 1e12
    values = {
        "log": "ln", "dim_lux": dark_lux, "cutoff_hz": poles_hz[0],
        "follower_hz": poles_hz[1], "photocurrent_pa": photocurrent_pa,
        "photon_noise_factor": factor,
    } | more  # fmt: skip
    return SensorParameters("noisy", side, side, theta, theta, **values)


def at_phase(state: PlainState, phase: F64) -> None:
    """Set the references this far below the signal, and forget what they tell of the noise."""
    assert state.noise_mean is not None
    assert state.noise_memory is not None
    signal = state.last_log.astype(np.float64)
    # the grid of references
    state.reference[:] = np.round((signal - phase) * 2.0**43) / 2.0**43
    state.noise_mean[:] = 0.0
    state.noise_memory[:] = 0.0


def random_phase(theta: float, side: int, seed: int) -> F64:
    """Distances of signal and reference, uniform in +-theta / 2, (side, side)."""
    return np.random.default_rng(seed).uniform(-theta / 2, theta / 2, (side, side))


def native_events(
    sensor: SensorParameters,
    light: F32,
    phase: F64,
    end_us: int,
    tick_us: int,
    seed: int = 0,
    slope: F64 | None = None,
) -> Events:
    """Return the events in (0, end_us], with references at these distances at time 0.

    Args:
        sensor: The sensor.
        light: (h, w) luminance at time 0.
        phase: (h, w) signal less reference at time 0, log units.
        end_us: When the last tick ends.
        tick_us: The length of each tick.
        seed: Of the sensor.
        slope: (h, w) by how much log light (with the dark current) rises in a us; None: it
            stands still
    """
    model = PlainModel(sensor, 1)
    _, state = model.step(light, model.init(seed), -1, 0)
    at_phase(state, phase)
    parts = []
    dark = sensor.dark_lux / WHITE_LUX
    for t in range(0, end_us, tick_us):
        if slope is not None:
            current = (light + dark) * np.exp(slope * (t + tick_us))
            now = np.asarray(current - dark, np.float32)
        else:
            now = light
        events, state = model.step(now, state, t, t + tick_us)
        parts.append(events)
    return join_events(parts)


def simulated_events(
    poles_hz: tuple[float, float],
    sigma: float,
    theta: float,
    phase: F64,
    end_us: int,
    seed: int,
    slope: F64 | None = None,
) -> Events:
    """Simulate white noise through two poles, and comparators that see it, in steps of 0.04 / b.

    du = -a u dt + white and dn = b (u - n) dt, with var n = sigma^2, var u = sigma^2 (a + b) / b
    and cov(u, n) = sigma^2. A pixel fires in the step in which n reaches a threshold, and its
    reference moves by exactly this threshold.

    Args:
        poles_hz: Of u (1 / a) and of n (1 / b), Hz; the second is the faster.
        sigma: Standard deviation of n, log units.
        theta: Both thresholds, log units.
        phase: (h, w) signal less reference at the beginning, log units.
        end_us: When it ends, us.
        seed: The seed of the random numbers.
        slope: (h, w) by how much the signal rises in a us, log units; None: it stands still.
    """
    rng = np.random.default_rng(seed)
    a, b = (2 * math.pi * 1e-6 * f for f in poles_hz)
    dt = 0.04 / b
    width, count = phase.shape[1], phase.size
    deviation = sigma * math.sqrt((a + b) / b)
    u = deviation * rng.standard_normal(count)
    # n given u: mean cov / var u, and what is left of its variance
    share = b / (a + b)
    n = share * u + sigma * math.sqrt(1 - share) * rng.standard_normal(count)
    above = phase.reshape(-1).copy()  # signal less reference
    rise = None if slope is None else slope.reshape(-1) * dt
    kept_u, kept_n = math.exp(-a * dt), math.exp(-b * dt)
    kick = np.float32(deviation * math.sqrt(1 - kept_u**2))
    half = 0.5 * (1 - kept_n)  # n follows the mean of u over the step
    white = np.empty(count, np.float32)
    level = np.empty(count)
    before = np.empty(count)
    found: list[tuple[float, np.ndarray[Any, Any], np.ndarray[Any, Any]]] = []
    for step in range(1, math.ceil(end_us / dt)):
        rng.standard_normal(out=white, dtype=np.float32)
        np.multiply(white, kick, out=white)
        np.multiply(u, half, out=before)
        u *= kept_u
        u += white
        n *= kept_n
        n += before
        np.multiply(u, half, out=before)
        n += before
        if rise is not None:
            above += rise
        np.add(n, above, out=level)
        np.abs(level, out=before)
        if before.max() >= theta:
            fired = np.flatnonzero(before >= theta)
            up = level[fired] > 0
            above[fired] -= np.where(up, theta, -theta)
            found.append((step * dt, fired, up))
    events = np.zeros(sum(len(fired) for _, fired, _ in found), EVENT_DTYPE)
    place = 0
    for t, fired, up in found:
        part = events[place : place + len(fired)]
        part["t"], part["x"], part["y"], part["p"] = round(t), fired % width, fired // width, up
        place += len(fired)
    return events


@dataclass(frozen=True)
class Estimate:
    """A ratio of sums over pixels, with its standard error from the variance over pixels."""

    value: float
    error: float

    @classmethod
    def of(cls, part: np.ndarray[Any, Any], whole: np.ndarray[Any, Any]) -> Estimate:
        """Make that of sum(part) / sum(whole), given one of each a pixel."""
        ratio = part.sum() / whole.sum()
        return cls(
            float(ratio), float(np.sqrt(np.square(part - ratio * whole).sum()) / whole.sum())
        )

    def agrees(self, other: Estimate, model_error: float, deviations: float = 3.3) -> bool:
        """Whether two differ by no more than the model's error and so many standard errors."""
        spread = deviations * math.hypot(self.error, other.error)
        return abs(self.value - other.value) <= model_error + spread


@dataclass(frozen=True)
class NoiseStatistics:
    """Of events of still light, by pixel."""

    rate_hz: Estimate
    flips: Estimate
    """share of successive events of a pixel that have the other polarity"""
    pixel: np.ndarray[Any, Any]
    intervals_us: F64
    pixels: int

    @classmethod
    def of(cls, events: Events, side: int, end_us: int) -> NoiseStatistics:
        """Make those of the events in (0, end_us] of a square sensor."""
        pixels = side * side
        index = events["y"].astype(np.int64) * side + events["x"]
        order = np.argsort(index, kind="stable")
        index, p, t = index[order], events["p"][order], events["t"][order]
        same = index[1:] == index[:-1]
        pixel = index[1:][same]
        flipped = (p[1:] != p[:-1])[same].astype(np.float64)
        successive = np.bincount(pixel, minlength=pixels).astype(np.float64)
        return cls(
            Estimate.of(
                np.bincount(index, minlength=pixels).astype(np.float64),
                np.full(pixels, end_us * 1e-6),
            ),
            Estimate.of(np.bincount(pixel, weights=flipped, minlength=pixels), successive),
            pixel,
            np.diff(t)[same].astype(np.float64),
            pixels,
        )

    def share_below(self, interval_us: float) -> Estimate:
        """The share of intervals that are at most this long."""
        short = (self.intervals_us <= interval_us).astype(np.float64)
        whole = np.bincount(self.pixel, minlength=self.pixels).astype(np.float64)
        return Estimate.of(np.bincount(self.pixel, weights=short, minlength=self.pixels), whole)

    def quantile_us(self, share: float) -> float:
        """The interval that this share is below."""
        return float(np.quantile(self.intervals_us, share))
