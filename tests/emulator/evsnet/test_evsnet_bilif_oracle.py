"""BiLIF against one pixel at a time in plain Python, byte for byte."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.evsnet.bilif import BiLIF, decay_tables

pytestmark = pytest.mark.property

F = np.float32


class OnePixel:
    """The rule as the issue words it, with scalars."""

    def __init__(self, unit: BiLIF, v: np.float32) -> None:
        self.unit, self.v, self.last, self.clamped = unit, v, 0, 0

    def tick(self, n: int, current: np.float32, begin_us: int, tick_us: int) -> tuple[int, int]:
        """(t_us, p) of its event, or (0, -1)."""
        on, off = self.unit.on, self.unit.off
        if not (current != 0 or self.v >= on or self.v <= -off):
            return 0, -1
        waited = n - self.last
        dv = self.v * self.unit.decay.low[waited % 256]
        if waited >= 256:
            dv = dv * (self.unit.decay.high[waited // 256] if waited < 2**20 else F(0))
        v1 = dv + current
        if abs(v1) > 64:
            self.clamped += 1
            v1 = F(math.copysign(64, v1))
        self.last = n
        if v1 >= on:
            self.v = v1 - on
            return self.stamp(float(on), float(dv), float(current), begin_us, tick_us, dv < on), 1
        if v1 <= -off:
            self.v = v1 + off
            stamp = self.stamp(-float(off), float(dv), float(current), begin_us, tick_us, dv > -off)
            return stamp, 0
        self.v = v1
        return 0, -1

    def stamp(
        self, level: float, dv: float, current: float, begin: int, tick: int, moving: bool
    ) -> int:
        exact = (level - dv) * tick / current if moving else 0.0
        return begin + min(max(math.ceil(exact), 1), tick)


LEVELS = st.floats(0.0625, 8.0, width=32)
CURRENTS = st.one_of(
    st.just(0.0),
    st.floats(-3.0, 3.0, width=32),
    st.floats(-200.0, 200.0, width=32),
    st.sampled_from([0.5, -0.5, 1.0, -1.0, 64.0, -64.0, 1e30, -1e30, 1e-30, -0.0]),
)


@settings(max_examples=150)
@given(
    on=LEVELS,
    off=LEVELS,
    exact=st.booleans(),
    tau_ticks=st.floats(1.0, 15_000.0),
    tick_us=st.sampled_from([1, 100, 1000, 10_000]),
    shape=st.sampled_from([(1, 1), (2, 3), (1, 5)]),
    data=st.data(),
)
def test_every_event_and_every_bit_of_the_state(
    on: float,
    off: float,
    exact: bool,
    tau_ticks: float,
    tick_us: int,
    shape: tuple[int, int],
    data: st.DataObject,
) -> None:
    # thresholds of 1 make ties likely
    unit = BiLIF(
        F(1 if exact else on),
        F(1 if exact else off),
        decay_tables(tau_ticks * tick_us * 1e-6, tick_us),
    )
    count = shape[0] * shape[1]
    share = data.draw(st.lists(st.floats(-0.99, 0.99), min_size=count, max_size=count))
    v = np.array(share, np.float32).reshape(shape) * min(unit.on, unit.off)
    last = np.zeros(shape, np.int64)
    pixels = [OnePixel(unit, value) for value in v.reshape(-1).copy()]
    # stillness of any length between the ticks in which something happens
    waits = data.draw(
        st.lists(
            st.sampled_from([1, 1, 1, 1, 2, 255, 256, 257, 70_000, 2**20, 2**40]),
            min_size=1,
            max_size=12,
        )
    )
    n, clamped = 0, 0
    for wait in waits:
        currents = data.draw(st.lists(CURRENTS, min_size=count, max_size=count))
        frame = np.array(currents, np.float32).reshape(shape)
        begin_us = n * tick_us
        events, more = unit.step(frame, v, last, n, begin_us, tick_us)
        clamped += more
        expected = []
        for place, (pixel, current) in enumerate(zip(pixels, frame.reshape(-1), strict=True)):
            stamp, polarity = pixel.tick(n, current, begin_us, tick_us)
            if polarity >= 0:
                expected.append((stamp, place, polarity))
        told = [(t, x + shape[1] * y, p) for t, x, y, p in events.tolist()]
        assert told == sorted(expected, key=lambda event: event[:2])
        assert v.tobytes() == np.array([pixel.v for pixel in pixels], np.float32).tobytes()
        assert last.reshape(-1).tolist() == [pixel.last for pixel in pixels]
        assert clamped == sum(pixel.clamped for pixel in pixels)
        n += wait
