"""Latency and jitter: when each pixel first responds to light that doubles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.emulator.sensor import SensorParameters, make_readout
from evs.emulator.sensor.parameters import ReadoutParameters
from evs.emulator.sensor.reference.passage import Band
from evs_lab.characterise.bench import Bench, LightExposure, pixel_numbers, share_of
from evs_lab.characterise.expected import DOUBLED, HALF, half_power_hz, latency_s
from evs_lab.characterise.quantity import Quantity
from evs_lab.characterise.settle import growing_us, settle, window_us

LADDER_LUX = (1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0)
PIXELS = 40_000
ATTEMPTS = 8
ENOUGH = 0.99
"""share of the pixels that were tested without noise, or are dead"""

NOISY = 0.1
"""deviation of the photon noise over the ON threshold from which on it moves first crossings"""

SLOW = 30.0
"""times the high pass: bandwidth below which it delays crossings by some percent"""

GROWTH = 0.04
"""length of a tick over the time since the step"""

CLOCK_S = 1e-6 / math.sqrt(12.0)
"""standard deviation of a stamp that is rounded to a microsecond"""
CLOCK_MATTERS_S = 2e-6


@dataclass(frozen=True)
class Latency:
    """Latency and jitter at one illuminance, that after the step."""

    lux: float
    share: float
    """of the pixels that responded; NaN: none was at rest"""
    mean_s: tuple[float, float]
    """mean over pixels, standard error"""
    jitter_s: tuple[float, float]
    """standard deviation over pixels, standard error"""


def measure_latency(
    bench: Bench, lux: float, *, pixels: int = PIXELS, tick_us: int | None = None
) -> Latency:
    """Measure the time from a step, at rest at lux / DOUBLED, to each pixel's first ON event.

    The readout has no bandwidth limits here, as if few pixels were lit at a time. Pixels with noise
    events are tested again: without them, pixels with low thresholds, which are noisier, would be
    missing.

    Args:
        bench: the bench with the sensor.
        lux: illuminance after the step.
        pixels: at most so many are tested.
        tick_us: length of the ticks after the step, which itself takes 1 us; None: they grow with
            the time since the step.
    """
    part = bench.part(pixels, readout=ReadoutParameters())
    window = sum(window_us(part, lux / DOUBLED))
    took_us = np.full(part.pixels, -1, np.int64)
    tested = np.zeros(part.pixels, bool)
    for attempt in range(ATTEMPTS):
        settled = settle(part, lux / DOUBLED, 1 + attempt * 2 * window)
        new = settled.quiet() & ~tested
        answer = _first_answers(settled.exposure.copy(), lux, window, tick_us)
        took_us[new] = answer[new]
        tested |= new
        if np.count_nonzero(tested | settled.dead) >= ENOUGH * part.pixels:
            break
    fired = took_us >= 0
    share = share_of(fired, tested)
    times = took_us[fired].astype(np.float64) * 1e-6
    nothing = (math.nan, math.nan)
    if share < HALF or len(times) < 2:
        return Latency(lux, share if tested.any() else math.nan, nothing, nothing)
    spread = float(times.std(ddof=1))
    centred = times - times.mean()
    kurtosis = float((centred**4).mean()) / max(spread**4, 1e-60)
    mean_error = math.hypot(spread / math.sqrt(len(times)), CLOCK_S)
    spread_error = spread * math.sqrt(max(kurtosis - 1.0, 0.0) / (4.0 * len(times)))
    return Latency(
        lux,
        share,
        (float(times.mean()), mean_error),
        (spread, math.hypot(spread_error, CLOCK_S)),
    )


def _first_answers(
    exposure: LightExposure, lux: float, window_us: int, tick_us: int | None
) -> npt.NDArray[np.int64]:
    """(h w,) us from a step to `lux` until the first ON event of each pixel has left; -1: none."""
    sensor = exposure.bench.sensor
    readout = make_readout(sensor)
    state = readout.init(exposure.bench.seed) if readout else None
    begin_us = exposure.t_us
    late_us = math.ceil(sensor.latency_us + 8.0 * sensor.latency_sigma_us)
    first = np.full(exposure.bench.pixels, -1, np.int64)
    total_us = window_us + late_us
    ticks = growing_us(total_us, GROWTH)
    if tick_us is not None:
        ticks = [1] + [tick_us] * math.ceil(total_us / tick_us)
    for us in ticks:
        events = exposure.expose(lux, us)
        if readout is not None and state is not None:
            events, state = readout.step(events, state, exposure.t_us - us, exposure.t_us)
        events = events[events["p"] == 1][::-1]  # the earliest is written last
        pixel = pixel_numbers(events, sensor)
        new = first[pixel] < 0
        # the step itself takes the first microsecond
        first[pixel[new]] = events["t"][new] - begin_us - 1
    return first


def latency_results(sensor: SensorParameters, found: Sequence[Latency]) -> list[Quantity]:
    """Mean and jitter of every illuminance."""
    means, jitters = [], []
    for at in found:
        mean, jitter = latency_s(sensor, at.lux)
        note = "the clock counts whole us" if at.mean_s[0] < CLOCK_MATTERS_S else ""
        note = "the set value has no photon noise" if _noisy(sensor, at.lux) else note
        if half_power_hz(sensor, at.lux) < SLOW * sensor.highpass_hz:
            note = "the high pass delays it"
        note = note if at.share >= HALF else "too dark for half of the pixels"
        note = "buried in noise" if math.isnan(at.share) else note
        means.append(Quantity("latency", "s", *at.mean_s, mean, at.lux, note))
        jitters.append(Quantity("jitter", "s", *at.jitter_s, jitter, at.lux, note))
    return means + jitters


def _noisy(sensor: SensorParameters, lux: float) -> bool:
    """Whether photon noise moves the first crossing of a step to this illuminance."""
    if not sensor.photocurrent_pa:
        return False
    dn = (lux + sensor.dark_current_lux) / sensor.lux_per_dn
    return Band.at(sensor, dn).sigma > NOISY * sensor.pos_thres
