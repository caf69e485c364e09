"""CPU time of the plain pixel per tick at 346 x 260, on one thread."""

from __future__ import annotations

import time

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.sensor import PlainModel, SensorParameters

TICKS = 320
PERIOD = 16


@pytest.mark.bench
@pytest.mark.parametrize("isa", _core.isa_available())
@pytest.mark.parametrize("moving", [0.0, 0.03, 1.0])
def test_plain_pixel_speed(isa: str, moving: float) -> None:
    sensor = SensorParameters("bench", 346, 260, 0.2, 0.2, 0.03)
    generator = np.random.default_rng(0)
    first = generator.uniform(0.05, 1, (260, 346)).astype(np.float32)
    # what moves is a band of rows, as objects are; it swings over two thresholds
    frames = [first.copy() for _ in range(PERIOD)]
    for k, frame in enumerate(frames):
        frame[: round(260 * moving)] *= np.float32(np.exp(0.2 * np.sin(2 * np.pi * k / PERIOD)))
    model = PlainModel(sensor, 1, isa)
    # the first tick draws the thresholds
    _, state = model.step(frames[0], model.init(0), -1000, 0)

    events, begin = 0, time.process_time()
    for k in range(TICKS):
        found, state = model.step(frames[k % PERIOD], state, k * 1000, (k + 1) * 1000)
        events += len(found)
    elapsed_us = (time.process_time() - begin) * 1e6 / TICKS
    print(f"\nplain {isa:8} {moving:4.0%} moving: {elapsed_us:5.0f} us, {events // TICKS} events")
    assert (events > 0) == (moving > 0)
