"""The stop watch and the pacer, on a clock that the test turns."""

from __future__ import annotations

import random
import time

import pytest

from evs.drivers.clock import Durations, Pacer, StopWatch, monotonic_s, sleep_s
from evs.emulator.base.protocols import Meter
from evs.msgs import EvsError


class Clock:
    """A clock that stands still but for what it is told; sleeping turns it."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            self.slept.append(seconds)
            self.now_s += seconds


def test_the_real_clock_goes_forward_and_sleeping_takes_time() -> None:
    before_s = monotonic_s()
    sleep_s(0.01)
    assert monotonic_s() - before_s >= 0.01
    for nothing in (0.0, -5.0, float("nan")):
        sleep_s(nothing)
    assert abs(monotonic_s() - time.monotonic()) < 1.0


def test_laps_belong_to_their_stages_and_a_tick_is_their_sum() -> None:
    clock = Clock()
    watch: StopWatch = StopWatch(clock)
    meter: Meter = watch
    for tick in range(100):
        clock.now_s += 7.0  # between ticks: nobody's
        watch.begin_tick()
        clock.now_s += 0.001
        meter.lap("world")
        clock.now_s += 0.002
        meter.lap("render")
        clock.now_s += 5.0
        watch.skip()  # waiting: nobody's
        clock.now_s += 0.003
        meter.lap("world")
        clock.now_s += 0.1 if tick == 99 else 0.004
        meter.lap("sink")
        watch.end_tick()
    times = watch.stage_ms(("world", "render", "sensor"))
    assert list(times) == ["world", "render", "sensor", "sink"]
    assert times["world"].median == pytest.approx(4.0, rel=0.006)
    assert times["render"].p99 == pytest.approx(2.0, rel=0.006)
    assert (times["sensor"].median, times["sensor"].p99) == (0.0, 0.0)
    # 99 of 100 ticks took 4 ms: the 99th percentile is the last of them
    assert times["sink"].p99 == pytest.approx(4.0, rel=0.006)


def test_a_tick_that_did_not_end_is_not_counted() -> None:
    clock = Clock()
    watch = StopWatch(clock)
    for _ in range(2):
        watch.begin_tick()
        clock.now_s += 0.5
        watch.lap("world")
    watch.end_tick()
    assert watch.stage_ms()["world"].median == pytest.approx(500.0, rel=0.006)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.9, 0.99, 1.0])
def test_quantiles_are_right_to_half_a_percent(share: float) -> None:
    source = random.Random(3)
    samples = sorted(source.lognormvariate(-7, 2) for _ in range(5001))
    durations = Durations()
    for sample in samples:
        durations.add(sample)
    exact = samples[max(1, -(-int(share * 1000) * 5001 // 1000)) - 1]
    assert durations.quantile_s(share) == pytest.approx(exact, rel=0.0051)


def test_quantiles_of_nothing_and_of_zeros_are_zero_and_memory_stays_bounded() -> None:
    durations = Durations()
    assert durations.quantile_s(0.5) == 0.0
    for odd in (0.0, -1.0, float("nan")):
        durations.add(odd)
    assert durations.quantile_s(0.99) == 0.0
    for exponent in range(200_000):
        durations.add(1e-9 * 1.0001 ** (exponent % 180_000))
    # 1 ns to 65 s in steps of 1 %
    assert len(durations.counts) < 2600


def test_a_free_pacer_never_waits() -> None:
    clock = Clock()
    pacer = Pacer(0.0, clock, clock.sleep)
    pacer.start(0)
    pacer.wait_until(10_000_000)
    assert clock.slept == []


def test_simulated_time_follows_the_wall_clock_times_speed() -> None:
    clock = Clock()
    pacer = Pacer(2.0, clock, clock.sleep)
    pacer.start(5_000_000)
    for tick in range(1, 1001):
        pacer.wait_until(5_000_000 + 1000 * tick)
    # 1 s of simulated time at twice the speed
    assert clock.now_s - 100.0 == pytest.approx(0.5, abs=1e-9)
    assert pacer.worst_late_s == pytest.approx(0.0, abs=1e-9)


def test_a_late_tick_is_caught_up_with_and_counted() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep)
    pacer.start(-1000)
    pacer.wait_until(0)
    clock.slept.clear()
    clock.now_s += 0.0045
    for tick in range(1, 5):
        pacer.wait_until(1000 * tick)
    assert clock.slept == []
    assert pacer.worst_late_s == pytest.approx(0.0035)
    pacer.wait_until(5000)
    pacer.wait_until(6000)
    # no drift: tick 6 leaves 7 ms after the start
    assert clock.now_s - 100.0 == pytest.approx(0.007)
    assert pacer.late_s == 0.0


def test_a_long_first_tick_is_preparation_and_not_late() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep)
    pacer.start(0)
    clock.now_s += 3.0
    pacer.wait_until(1000)
    pacer.wait_until(2000)
    assert (pacer.worst_late_s, pacer.slipped_s) == (0.0, 0.0)
    # time began when it was over
    assert clock.now_s - 103.0 == pytest.approx(0.001)
    # and so it is after each start
    pacer.start(0)
    clock.now_s += 3.0
    pacer.wait_until(1000)
    assert pacer.worst_late_s == 0.0


def test_the_first_wait_starts_a_pacer_that_was_not_started() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep)
    pacer.wait_until(3_000_000)
    assert clock.slept == []
    pacer.wait_until(3_002_000)
    assert clock.slept == [pytest.approx(0.002)]


@pytest.mark.parametrize("speed", [-1.0, float("nan"), float("inf")])
def test_an_impossible_speed_is_refused(speed: float) -> None:
    with pytest.raises(EvsError, match="speed"):
        Pacer(speed)


def test_a_clock_that_goes_back_is_not_waited_for() -> None:
    clock = Clock()
    pacer = Pacer(2.0, clock, clock.sleep)
    pacer.start(0)
    for tick in range(1, 301):
        if tick == 100:
            clock.now_s -= 3600.0
        if tick == 200:
            clock.now_s -= 0.5
        pacer.wait_until(1000 * tick)
    # no wait is longer than a tick, and all of them are as long as simulated time
    assert max(clock.slept) == pytest.approx(0.0005)
    assert sum(clock.slept) == pytest.approx(0.15)
    assert pacer.went_back_s == pytest.approx(3600.5)
    assert pacer.report()["clock_back_s"] == pytest.approx(3600.5)
    assert (pacer.worst_late_s, pacer.slipped_s) == (pytest.approx(0.0, abs=1e-9), 0.0)


def test_several_ticks_may_be_waited_for_at_once() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep)
    pacer.start(0)
    pacer.wait_until(1000)
    pacer.wait_until(9000)
    assert clock.slept == [pytest.approx(0.001), pytest.approx(0.008)]
    assert pacer.went_back_s == 0.0
