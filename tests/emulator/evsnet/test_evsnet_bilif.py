"""BiLIF: what the paper's equations ask of it, its decay, and one pixel at a time byte for byte."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Context, Decimal
from math import ulp

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.evsnet.bilif import (
    HIGH_ENTRIES,
    LEAST,
    LOW_TICKS,
    BiLIF,
    Decay,
    crossing_us,
    decay_per_tick,
    decay_tables,
)
from evs.msgs import EVENT_DTYPE, EvsError


def halving() -> Decay:
    """d = 1/2, so that every number here is exact."""
    low = np.ldexp(np.ones(256, np.float32), -np.arange(256)).astype(np.float32)
    low[101:] = 0
    return Decay(low, np.concatenate([np.ones(1), np.zeros(4095)]).astype(np.float32))


def keeping() -> Decay:
    """d = 1."""
    return Decay(np.ones(256, np.float32), np.ones(4096, np.float32))


@dataclass
class Pixel:
    """One pixel through its ticks of 1000 us."""

    unit: BiLIF
    v0: float = 0.0
    tick_us: int = 1000

    def __post_init__(self) -> None:
        self.v = np.full((1, 1), self.v0, np.float32)
        self.last = np.zeros((1, 1), np.int64)
        self.clamped = 0
        self.stamps: list[list[int]] = []
        """of each tick"""

    def run(self, currents: list[float]) -> list[tuple[int, int, float]]:
        """(ON less OFF events; the first's stamp after the tick's start or 0; v) of each tick."""
        out = []
        for tick, current in enumerate(currents):
            frame = np.full((1, 1), current, np.float32)
            events, clamped = self.unit.step(
                frame, self.v, self.last, tick, tick * self.tick_us, self.tick_us
            )
            self.clamped += clamped
            self.stamps.append((events["t"] - tick * self.tick_us).tolist())
            assert len(set(events["p"].tolist())) <= 1
            event, stamp = 0, 0
            if len(events):
                event = len(events) if events["p"][0] else -len(events)
                stamp = self.stamps[-1][0]
            out.append((event, stamp, float(self.v[0, 0])))
        return out


def unit(on: float = 1.0, off: float = 1.0, decay: Decay | None = None, most: int = 1) -> BiLIF:
    return BiLIF(np.float32(on), np.float32(off), decay or keeping(), most)


def test_charge_fire_reset_of_both_polarities() -> None:
    pixel = Pixel(unit())
    assert pixel.run([0.5, 0.25, 0.75, -1.0, -1.0]) == [
        (0, 0, 0.5),
        (0, 0, 0.75),
        (1, 334, 0.5),  # 1/4 of the 3/4 were missing, a third of the tick
        (0, 0, -0.5),
        (-1, 500, -0.5),
    ]


def test_a_threshold_just_reached_fires() -> None:
    for current, event in ((1.0, 1), (-1.0, -1)):
        assert Pixel(unit()).run([current]) == [(event, 1000, 0.0)]
        below = float(np.nextafter(np.float32(current), np.float32(0)))
        assert Pixel(unit()).run([below]) == [(0, 0, below)]


def test_thresholds_of_two_sizes() -> None:
    pixel = Pixel(unit(on=0.5, off=2.0))
    assert pixel.run([0.5, -1.5, -0.5, 0.75]) == [
        (1, 1000, 0.0),
        (0, 0, -1.5),
        (-1, 1000, 0.0),
        (1, 667, 0.25),
    ]


def test_leak_of_the_ticks_between() -> None:
    pixel = Pixel(unit(decay=halving()), v0=0.75)
    # two ticks without current: v is told as of the last active tick, then halved three times
    assert pixel.run([0.0, 0.0, 0.0, 0.125]) == [
        (0, 0, 0.75),
        (0, 0, 0.75),
        (0, 0, 0.75),
        (0, 0, 0.75 / 8 + 0.125),
    ]
    assert pixel.last[0, 0] == 3


def test_leak_alone_never_fires() -> None:
    pixel = Pixel(unit(decay=halving()), v0=float(np.nextafter(np.float32(1), np.float32(0))))
    assert {event for event, _, _ in pixel.run([0.0] * 300)} == {0}


def test_leak_comes_before_the_charge() -> None:
    """A membrane of 1/2 that gets 1/2 would fire, if it were not 1/4 by then."""
    assert Pixel(unit(decay=halving()), v0=0.0).run([0.5, 0.5, 0.625])[1:] == [
        (0, 0, 0.75),
        (1, 1000, 0.0),
    ]


def test_saturation_one_event_a_tick_until_it_is_spent() -> None:
    trail = Pixel(unit()).run([5.25, *[0.0] * 8])
    assert [event for event, _, _ in trail] == [1, 1, 1, 1, 1, 0, 0, 0, 0]
    # the first where the line crosses, the others by the quarter of a threshold that is left
    assert [stamp for _, stamp, _ in trail] == [191, 750, 750, 750, 750, 0, 0, 0, 0]
    assert trail[-1][2] == 0.25


def test_the_trail_leaks() -> None:
    trail = Pixel(unit(decay=halving())).run([8.0, *[0.0] * 6])
    # 8 -> 7 -> 3.5 - 1 -> 1.25 - 1 -> .25, told as of then
    assert [(event, v) for event, _, v in trail] == [
        (1, 7.0),
        (1, 2.5),
        (1, 0.25),
        *[(0, 0.25)] * 4,
    ]


@pytest.mark.parametrize("sign", [1, -1])
def test_many_events_of_a_step_fire_in_its_tick_along_the_line(sign: int) -> None:
    pixel = Pixel(unit(most=64), v0=sign * 0.5)
    trail = pixel.run([sign * 4.0, 0.0, sign * 0.25, sign * 2.0])
    assert trail == [
        (sign * 4, 125, sign * 0.5),
        (0, 0, sign * 0.5),
        (0, 0, sign * 0.75),
        (sign * 2, 125, sign * 0.75),
    ]
    # V crosses 1, 2, 3 and 4 on its line from 0.5 to 4.5
    assert pixel.stamps == [[125, 375, 625, 875], [], [], [125, 625]]


def test_many_thresholds_of_two_sizes_just_reached() -> None:
    pixel = Pixel(unit(on=0.5, off=2.0, most=64))
    assert pixel.run([1.5, -4.0, -1.5, 2.0]) == [
        (3, 334, 0.0),
        (-2, 500, 0.0),
        (0, 0, -1.5),
        (1, 1000, 0.0),
    ]


def test_more_than_the_most_events_stay_in_the_membrane() -> None:
    pixel = Pixel(unit(on=0.25, most=64))
    # 160 thresholds: 64 along the line, 64 and 32 at the end of the ticks after it
    trail = pixel.run([40.0, 0.0, 0.0, 0.0])
    assert [(count, v) for count, _, v in trail] == [(64, 24.0), (64, 8.0), (32, 0.0), (0, 0.0)]
    assert pixel.stamps[0] == [math.ceil(1000 * n * 0.25 / 40) for n in range(1, 65)]
    assert pixel.stamps[1:3] == [[1000] * 64, [1000] * 32]
    # what is left fires whatever current comes, and none
    for current in (float("nan"), -1.0, float("inf")):
        pixel = Pixel(unit(on=0.25, most=64))
        assert [count for count, _, _ in pixel.run([40.0, current])] == [64, 64]
        assert pixel.stamps[1] == [1000] * 64


@pytest.mark.parametrize("sign", [1, -1])
def test_a_huge_step_is_clamped_and_counted(sign: int) -> None:
    pixel = Pixel(unit())
    trail = pixel.run([sign * 1e30, *[0.0] * 70])
    assert pixel.clamped == 1
    assert sum(event for event, _, _ in trail) == sign * 64
    assert [event for event, _, _ in trail[64:]] == [0] * 7
    assert trail[0][1:] == (1, sign * 63.0)


def test_the_clamp_is_counted_every_time() -> None:
    pixel = Pixel(unit())
    pixel.run([100.0, 100.0, 1.0, 0.5, -200.0])
    # 64, 63 + 100, 64 of 63 + 1, 63.5, 62.5 - 200
    assert pixel.clamped == 3


def test_infinite_and_missing_currents_leave_a_membrane_that_works() -> None:
    pixel = Pixel(unit())
    trail = pixel.run([0.5, float("nan"), 0.5, float("inf"), float("-inf"), *[0.0] * 70, 1.0])
    assert trail[:4] == [(0, 0, 0.5), (0, 0, 0.5), (1, 1000, 0.0), (1, 1, 63.0)]
    assert trail[4] == (-1, 1, -63.0)
    assert pixel.clamped == 3
    assert trail[-2] == (0, 0, 0.0)
    assert trail[-1] == (1, 1000, 0.0)


def test_crossing_stamps() -> None:
    def stamp(level: float, before: float, charge: float, tick_us: int = 1000) -> int:
        number, threshold = np.array([abs(level)]), np.array([np.sign(level)])
        args = np.array([before], np.float32), np.array([charge], np.float32)
        return int(crossing_us(number, threshold, *args, tick_us)[0])

    assert stamp(1.0, 0.0, 1.0) == 1000
    assert stamp(1.0, 0.0, 4.0) == 250
    assert stamp(1.0, 0.0, 3.0) == 334  # rounded up
    assert stamp(-1.0, 0.0, -4.0) == 250
    assert stamp(-2.0, -1.5, -1.0) == 500
    assert stamp(1.0, 0.999, 1000.0) == 1  # not 0: the start belongs to the tick before
    # there already: what is beyond whole thresholds is left of the tick
    assert stamp(1.0, 1.0, 1.0) == 1000
    assert stamp(1.0, 5.25, -3.0) == stamp(-1.0, -5.25, 0.0) == 750
    assert stamp(1.0, np.nextafter(np.float32(2), np.float32(1)), 0.0) == 1
    assert stamp(1.0, 0.0, 1.0, tick_us=1) == 1
    assert stamp(1.0, 0.25, 1.0, tick_us=2**28 - 1) == 201326592


@pytest.mark.statistical
def test_the_stamps_of_trails_are_spread_evenly_over_the_tick() -> None:
    count = 100_000
    v = np.random.default_rng(5).uniform(1.0, 9.0, (1, count)).astype(np.float32)
    events, _ = unit().step(np.zeros_like(v), v, np.zeros(v.shape, np.int64), 1, 0, 1000)
    tenths = np.bincount((events["t"] - 1) // 100, minlength=10)
    # 10 shares of 0.1, five standard deviations each
    assert np.all(np.abs(tenths - 0.1 * count) < 5 * np.sqrt(0.09 * count))


def test_events_of_a_tick_are_sorted_by_time_then_by_pixel() -> None:
    current = np.array([[1.0, 2.0, -2.0], [4.0, 0.0, 2.0]], np.float32)
    v, last = np.zeros((2, 3), np.float32), np.zeros((2, 3), np.int64)
    events, _ = unit().step(current, v, last, 7, 7000, 1000)
    assert events.dtype == EVENT_DTYPE
    assert events.tolist() == [
        (7250, 0, 1, 1),
        (7500, 1, 0, 1),
        (7500, 2, 0, 0),
        (7500, 2, 1, 1),
        (8000, 0, 0, 1),
    ]
    assert not np.any(np.frombuffer(events.tobytes(), np.uint8).reshape(-1, 16)[:, 13:])
    # the pixel without current is as it was
    assert last.tolist() == [[7, 7, 7], [7, 0, 7]]


def test_untouched_pixels_hold_their_bits() -> None:
    v = np.array([[0.3, -0.7, 0.0]], np.float32)
    kept, last = v.copy(), np.zeros((1, 3), np.int64)
    tables = decay_tables(0.4, 1000)
    for tick in range(50):
        current = np.array([[0.0, -0.0, 0.0]], np.float32)
        events, _ = unit(decay=tables).step(current, v, last, tick, tick * 1000, 1000)
        assert len(events) == 0
    assert v.tobytes() == kept.tobytes()
    assert not last.any()


class OnePixel:
    """The rule with scalars."""

    def __init__(self, unit: BiLIF, v: np.float32) -> None:
        self.unit, self.v, self.last, self.clamped = unit, v, 0, 0

    def tick(
        self, n: int, current: np.float32, begin_us: int, tick_us: int
    ) -> list[tuple[int, int]]:
        """(t_us, p) of its events."""
        on, off, most = self.unit.on, self.unit.off, np.float32(self.unit.most)
        if not (current != 0 or self.v >= on or self.v <= -off):
            return []
        waited = n - self.last
        dv = self.v * self.unit.decay.low[waited % 256]
        if waited >= 256:
            dv = dv * (self.unit.decay.high[waited // 256] if waited < 2**20 else np.float32(0))
        v1 = dv + current
        if abs(v1) > 64:
            self.clamped += 1
            v1 = np.float32(math.copysign(64, v1))
        self.last = n
        self.v = v1
        found = []
        for size, sign in ((on, 1), (off, -1)):
            count = int(min(sign * v1 / size, most))
            if count >= 1:
                self.v = v1 - np.float32(sign * count) * size
            for k in range(1, count + 1):
                level = sign * k * float(size)
                # the line goes from dv to dv + current
                missing = sign * (level - float(dv)) > 0 and current != 0
                inside = float(dv) / (sign * float(size))
                left = 1 - (inside - math.floor(inside))
                exact = (
                    (level - float(dv)) * tick_us / float(current) if missing else left * tick_us
                )
                stamp = begin_us + min(max(math.ceil(exact), 1), tick_us)
                found.append((stamp, int(sign > 0)))
        return found


LEVELS = st.floats(0.0625, 8.0, width=32)
CURRENTS = st.one_of(
    st.just(0.0),
    st.floats(-3.0, 3.0, width=32),
    st.floats(-200.0, 200.0, width=32),
    st.sampled_from([0.5, -0.5, 1.0, -1.0, 64.0, -64.0, 1e30, -1e30, 1e-30, -0.0]),
)


@pytest.mark.slow
@pytest.mark.property
@settings(max_examples=150)
@given(
    on=LEVELS,
    off=LEVELS,
    exact=st.booleans(),
    tau_ticks=st.floats(1.0, 15_000.0),
    tick_us=st.sampled_from([1, 100, 1000, 10_000]),
    shape=st.sampled_from([(1, 1), (2, 3), (1, 5)]),
    most=st.sampled_from([1, 2, 64]),
    data=st.data(),
)
def test_every_event_and_every_bit_of_the_state(
    on: float,
    off: float,
    exact: bool,
    tau_ticks: float,
    tick_us: int,
    shape: tuple[int, int],
    most: int,
    data: st.DataObject,
) -> None:
    # thresholds of 1 make ties likely
    unit = BiLIF(
        np.float32(1 if exact else on),
        np.float32(1 if exact else off),
        decay_tables(tau_ticks * tick_us * 1e-6, tick_us),
        most,
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
            events_of_it = pixel.tick(n, current, begin_us, tick_us)
            expected += [(stamp, place, polarity) for stamp, polarity in events_of_it]
        told = [(t, x + shape[1] * y, p) for t, x, y, p in events.tolist()]
        assert told == sorted(expected, key=lambda event: event[:2])
        assert v.tobytes() == np.array([pixel.v for pixel in pixels], np.float32).tobytes()
        assert last.reshape(-1).tolist() == [pixel.last for pixel in pixels]
        assert clamped == sum(pixel.clamped for pixel in pixels)
        n += wait


EXACT = Context(prec=80)


def exact_power(tau_s: float, tick_us: int, ticks: int) -> float:
    """e^(-ticks dt / tau) to the last bit of a float64."""
    tau_us = EXACT.multiply(Decimal(tau_s), Decimal(10**6))
    return float(EXACT.exp(EXACT.divide(Decimal(-ticks * tick_us), tau_us)))


def after(tau_s: float, tick_us: int, v: float, ticks: int) -> np.float32:
    decay = decay_tables(tau_s, tick_us)
    return np.float32(decay(np.array([v], np.float32), np.array([ticks], np.int64))[0])


@pytest.mark.parametrize(
    ("tau_s", "tick_us"), [(0.38, 1000), (0.85, 1000), (0.005, 250), (15, 1000)]
)
def test_one_tick_is_the_nearest_number(tau_s: float, tick_us: int) -> None:
    tau_us = EXACT.multiply(Decimal(tau_s), Decimal(10**6))
    exact = EXACT.exp(EXACT.divide(Decimal(-tick_us), tau_us))
    d = decay_per_tick(tau_s, tick_us)
    assert abs(Decimal(d) - exact) <= Decimal(ulp(d)) / 2


@pytest.mark.parametrize(
    ("tau_s", "tick_us"), [(0.38, 1000), (0.85, 1000), (0.005, 250), (15, 1000)]
)
def test_entries_are_exact_powers_rounded(tau_s: float, tick_us: int) -> None:
    tables = decay_tables(tau_s, tick_us)
    assert tables.low.shape == (LOW_TICKS,)
    assert tables.high.shape == (HIGH_ENTRIES,)
    for table, stride in ((tables.low, 1), (tables.high, LOW_TICKS)):
        assert table.dtype == np.float32
        assert table[0] == 1
        for place in {*range(0, len(table), 37), len(table) - 1}:
            exact = exact_power(tau_s, tick_us, place * stride)
            # float64 powers drift by far less than half a bit of float32
            assert table[place] == pytest.approx(
                exact if exact > LEAST else 0.0, rel=2.0**-24 * 1.01
            )


def test_many_ticks_at_once_are_the_ticks_one_by_one() -> None:
    """A tick of the slow way rounds twice by half a bit, all of them at once four times."""
    one = decay_tables(0.5, 1000).low[1]
    v = np.float32(0.97)
    for ticks in range(1, 3000):
        v = v * one
        exact = float(np.float32(0.97)) * exact_power(0.5, 1000, ticks)
        at_once = float(after(0.5, 1000, 0.97, ticks))
        assert at_once == pytest.approx(exact, rel=4 * 2.0**-24)
        apart = abs(float(v) - at_once)
        assert apart <= (2 * ticks + 4) * 2.0**-24 * exact
        assert apart < 1e-6 * ticks


def test_no_tick_changes_nothing_and_short_waits_round_once() -> None:
    assert after(0.5, 1000, 0.123, 0) == np.float32(0.123)
    low = decay_tables(0.5, 1000).low
    assert after(0.5, 1000, 0.123, 255) == np.float32(0.123) * low[255]


def test_the_end_of_the_table_is_zero() -> None:
    end = LOW_TICKS * HIGH_ENTRIES
    assert after(15.0, 1000, 64.0, 15_000 * 69) > 0
    for ticks in (end, end + 1, 2**52):
        assert after(15.0, 1000, 64.0, ticks) == 0
    # where the last entry is just over the least that comes in
    assert after(15.126, 1000, 64.0, end - 1) > 0
    assert after(15.126, 1000, 64.0, end) == 0


def test_nothing_below_2_to_the_minus_100_comes_in() -> None:
    tables = decay_tables(0.5, 1000)
    every = np.concatenate([tables.low, tables.high])
    assert np.all((every == 0) | (every >= LEAST))
    assert np.any(every == 0)


def test_a_time_constant_that_outlasts_the_table_is_refused() -> None:
    with pytest.raises(
        EvsError, match=r"^tau_s is 16; with ticks of 1000 us, it can be at most 15.1 s$"
    ):
        decay_tables(16.0, 1000)


def test_a_time_constant_of_nothing_forgets_at_once() -> None:
    for tau_s in (1e-9, 5e-324):
        assert after(tau_s, 1000, 1.0, 1) == 0
        assert after(tau_s, 1000, 1.0, 0) == 1
