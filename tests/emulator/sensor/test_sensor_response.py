"""Inside a tick the signal is what both poles make of light that is a line: events of ticks of 1 ms
against the filters' equations in steps of a microsecond, in float64."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import PlainModel, SensorParameters

SIDE, TICK_US, TICKS, THETA = 12, 1000, 24, 0.1
FIXED = {"log": "ln", "dark_lux": 1e-3, "dim_lux": 1e6, "bright_lux": 1e-3}
"""A bandwidth that is the same in any light."""


def corners(seed: int) -> F64:
    """(ticks, h, w) log light at the end of each tick: slow walks, jumps and rests."""
    rng = np.random.default_rng(seed)
    step = rng.normal(0.0, 0.08, (TICKS, SIDE, SIDE))
    step += rng.normal(0.0, 0.5, step.shape) * (rng.random(step.shape) < 0.1)
    step[rng.random(step.shape) < 0.2] = 0.0
    return np.asarray(3.0 + np.cumsum(step, axis=0))


def crossings(light: F64, sensor: SensorParameters) -> list[list[float]]:
    """The times of each pixel's events, by Heun's steps of the equations and exact comparators."""
    w1, w2 = (2.0 * math.pi * 1e-6 * hz for hz in (sensor.cutoff_hz, sensor.follower_hz))

    def rise(p: F64, y: F64, x: F64) -> tuple[F64, F64]:
        d = x - p
        first = w1 * (-np.expm1(-d) if sensor.filter == "large_signal" else d)
        return (first, w2 * (p - y)) if w2 else (first, first)

    p, y, reference = light[0].copy(), light[0].copy(), light[0].copy()
    times: list[list[float]] = [[] for _ in range(SIDE * SIDE)]
    for tick in range(1, TICKS):
        line = (light[tick] - light[tick - 1]) / TICK_US
        for us in range(TICK_US):
            x0 = light[tick - 1] + line * us
            p0, y0 = rise(p, y, x0)
            p1, y1 = rise(p + p0, y + y0, x0 + line)
            p, before = p + 0.5 * (p0 + p1), y
            y = y + 0.5 * (y0 + y1)
            for sign in (1.0, -1.0):
                while (crossed := sign * (y - reference) >= THETA).any():
                    reference = np.where(crossed, reference + sign * THETA, reference)
                    share = (reference - before) / np.where(y == before, 1.0, y - before)
                    for i in np.flatnonzero(crossed):
                        times[i].append(tick * TICK_US + us + share.flat[i])
    return times


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("law", "cutoff_hz", "follower_hz", "bound_us"),
    [
        ("exact", 400.0, 0.0, 1),
        ("exact", 2000.0, 300.0, 1),
        ("exact", 250.0, 250.0, 1),
        ("large_signal", 20_000.0, 286.0, 1),
        ("large_signal", 3000.0, 16_400.0, 1),
        # slow as the tick: its rate changes in it by half
        ("large_signal", 300.0, 600.0, 40),
    ],
)
def test_events_of_long_ticks_are_those_of_the_equations(
    law: str, cutoff_hz: float, follower_hz: float, bound_us: int
) -> None:
    sensor = SensorParameters(
        "response", SIDE, SIDE, THETA, THETA,
        cutoff_hz=cutoff_hz, follower_hz=follower_hz, filter=law, **FIXED,  # type: ignore[arg-type]
    )  # fmt: skip
    light = corners(7)
    model = PlainModel(sensor, 1)
    state = model.init(0)
    found: list[list[int]] = [[] for _ in range(SIDE * SIDE)]
    for tick in range(TICKS):
        dn: F32 = np.exp(light[tick]).astype(np.float32)
        luminance = ((dn - np.float32(sensor.dark_dn)) / np.float32(sensor.exposure_dn)).astype(
            np.float32
        )
        events, state = model.step(luminance, state, tick * TICK_US, (tick + 1) * TICK_US)
        for t, x, y in events[["t", "x", "y"]].tolist():
            found[y * SIDE + x].append(t)
    expected = crossings(light, sensor)
    counted = sum(map(len, expected))
    assert counted > 1200
    # what turns back inside a tick is lost
    same = [i for i in range(SIDE * SIDE) if len(found[i]) == len(expected[i])]
    assert len(same) > 0.8 * SIDE * SIDE
    late = np.concatenate([np.array(found[i]) - np.ceil(expected[i]) for i in same])
    assert np.quantile(np.abs(late), 0.95) <= bound_us
    assert np.median(late) == 0
