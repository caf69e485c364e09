"""What is left of a membrane after m ticks."""

from __future__ import annotations

from decimal import Context, Decimal
from math import ulp

import numpy as np
import pytest

from evs.emulator.evsnet.bilif import (
    HIGH_ENTRIES,
    LEAST,
    LOW_TICKS,
    decay_per_tick,
    decay_tables,
)
from evs.msgs import EvsError

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
        EvsError, match=r"^tau_s is 16; in ticks of 1000 us make it at most 15.1 s$"
    ):
        decay_tables(16.0, 1000)


def test_a_time_constant_of_nothing_forgets_at_once() -> None:
    for tau_s in (1e-9, 5e-324):
        assert after(tau_s, 1000, 1.0, 1) == 0
        assert after(tau_s, 1000, 1.0, 0) == 1
