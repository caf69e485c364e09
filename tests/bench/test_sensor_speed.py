"""CPU time of the plain pixel per tick at 346 x 260, on one thread."""

from __future__ import annotations

import time

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.sensor import PlainModel, SensorParameters

TICKS = 200


@pytest.mark.bench
@pytest.mark.parametrize("isa", _core.isa_available())
@pytest.mark.parametrize("moving", [0.0, 0.03, 1.0])
def test_plain_pixel_speed(isa: str, moving: float) -> None:
    sensor = SensorParameters("bench", 346, 260, 0.2, 0.2, 0.03)
    generator = np.random.default_rng(0)
    first = generator.uniform(0.05, 1, (260, 346)).astype(np.float32)
    # what moves is a band of rows, as objects are; it changes by a tenth of a threshold a tick
    rows = round(260 * moving)
    frames = [first.copy() for _ in range(TICKS)]
    for k, frame in enumerate(frames):
        frame[:rows] *= np.float32(np.exp(0.5 * np.sin(0.04 * k)))
    model = PlainModel(sensor, 1, isa)
    state, events = model.init(0), 0
    begin = time.process_time()
    for k, frame in enumerate(frames):
        found, state = model.step(frame, state, k * 1000, (k + 1) * 1000)
        events += len(found)
    elapsed_us = (time.process_time() - begin) * 1e6 / TICKS
    print(f"\nplain {isa:8} {moving:5.0%} moving: {elapsed_us:6.0f} us, {events // TICKS} events")
    assert (events > 0) == (moving > 0)
