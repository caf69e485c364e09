"""Rates over a period, on a clock that the test moves."""

import math

from manual_clock import ManualClock

from evs.drivers.bus import Rates


def test_rates_are_counts_over_time() -> None:
    clock = ManualClock()
    rates = Rates(1.0, clock)
    for gap_s in (0.25, 0.5, 0.125):
        clock.now_s += gap_s
        rates.add(events=300, size_bytes=4800)
    clock.now_s += 1.125
    assert rates.remaining_s == -1.0
    rate = rates.take()
    assert (rate.packets_hz, rate.events_hz, rate.bytes_hz) == (1.5, 450.0, 7200.0)
    assert (rate.shortest_s, rate.longest_s, rate.packets) == (0.125, 0.5, 3)


def test_a_new_period_forgets_the_old_one_but_not_the_last_packet() -> None:
    clock = ManualClock()
    rates = Rates(1.0, clock)
    rates.add(1, 16)
    clock.now_s += 1.0
    assert math.isnan(rates.take().shortest_s)
    assert rates.remaining_s == 1.0
    clock.now_s += 2.0
    rates.add(1, 16)
    rate = rates.take()
    assert (rate.packets, rate.packets_hz, rate.shortest_s) == (1, 0.5, 3.0)


def test_an_empty_period_is_zero() -> None:
    clock = ManualClock()
    rates = Rates(1.0, clock)
    rate = rates.take()
    assert (rate.packets, rate.packets_hz, rate.bytes_hz) == (0, 0.0, 0.0)
    assert math.isnan(rate.longest_s)
