"""The events that a network should produce: those of `plain` pixels in converged light."""

from __future__ import annotations

import dataclasses

import numpy as np

from evs.emulator.base.scene import F32, F64, U8
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters, resolve_sensor

IDEAL = SensorConfig(preset="ideal", pos_thres=0.2, neg_thres=0.2)
"""No noise, no bandwidth: linlog(e) of 255 DN for white, no dark current"""
NOISY = SensorConfig(preset="davis346", pos_thres=0.2, neg_thres=0.2)

GRID = 2.0**43
"""References are multiples of 1 / GRID: core/sensor/comparator.h."""
MOST_COUNTED = 255


def draw_phases(rng: np.random.Generator, count: int) -> F32:
    """Draw phases: where the references of pixels are, (count,) float32, uniform in (-1, 1)."""
    edge = np.nextafter(np.float32(1), np.float32(0))
    return np.clip(rng.uniform(-1.0, 1.0, count).astype(np.float32), -edge, edge)


def event_counts(
    truth: F32, phase: F32, config: SensorConfig, *, seed: int = 0, tick_us: int = 1000
) -> U8:
    """Count ON and OFF events of each tick and pixel, (2, K, P) uint8, at most 255.

    Args:
        truth: (K, P) luminance.
        phase: (P,), how far the first light is above the pixel's reference, in the pixel's own
            thresholds: ON thresholds where it is positive, OFF ones where negative.
        config: of the sensor.
        seed: of all random numbers.
        tick_us: length of a tick.
    """
    ticks, count = truth.shape
    sensor = dataclasses.replace(resolve_sensor(config), width=count, height=1)
    model = PlainModel(sensor, threads=1)
    state = model.init(seed)
    counts = np.zeros((2, ticks, count), np.uint8)
    for tick in range(ticks):
        events, state = model.step(
            truth[tick : tick + 1], state, tick * tick_us, (tick + 1) * tick_us
        )
        if tick == 0:
            # events of noise in the first tick do not count: it only sets the log light
            _shift(state, phase, _thresholds(model, sensor, seed, phase))
            continue
        for row, polarity in enumerate((1, 0)):
            found = np.bincount(events["x"][events["p"] == polarity], minlength=count)
            counts[row, tick] = np.minimum(found, MOST_COUNTED)
    return counts


def _thresholds(model: PlainModel, sensor: SensorParameters, seed: int, phase: F32) -> F64:
    """Threshold of each pixel, (P,), of the polarity that its phase points to."""
    pattern = model.pattern(seed)
    on, off = (
        np.broadcast_to(np.asarray(part, np.float64), (sensor.height, sensor.width)).ravel()
        for part in (pattern.on, pattern.off)
    )
    return np.where(phase > 0, on, off)


def _shift(state: PlainState, phase: F32, thresholds: F64) -> None:
    """Put the references below the first light by phase times threshold; a dead pixel has none."""
    below = np.where(np.isfinite(thresholds), phase * thresholds, 0.0)
    shifted = np.round((state.last_log.ravel() - below) * GRID) / GRID
    reference = shifted.reshape(state.reference.shape)
    # a blind pixel takes its reference when it wakes
    state.reference[:] = np.where(np.isnan(state.reference), np.nan, reference)
    if state.due_us is not None:
        # nothing may be skipped on account of where the references were
        state.due_us[:] = state.clock_us
