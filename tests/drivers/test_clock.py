"""The stop watch and the pacer, on a clock that the test sets."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from manual_clock import ManualClock

from evs.drivers.clock import Durations, Pacer, StopWatch, monotonic_s, sleep_s
from evs.emulator.base.protocols import Meter
from evs.msgs import EvsError

TICK_S = 0.001

_seconds = st.sampled_from([0.0, 0.0, 1e-4, 2e-3, 0.2]) | st.floats(0.0, 1.0)
# a tick, several ticks at once, and messages of a file that are slightly out of order
_steps_us = st.sampled_from([1000, 1000, 100, 0, -500, 40_000])


def ticking(
    clock: ManualClock, pacer: Pacer, costs_s: Callable[[int], float], ticks: int
) -> list[tuple[float, float]]:
    """Return (wall s, late s) at the end of each tick, where tick k costs costs_s(k) seconds."""
    found = []
    begin_s = clock.now_s
    pacer.start(0)
    for tick in range(1, ticks + 1):
        clock.now_s += costs_s(tick)
        pacer.wait_until(1000 * tick)
        found.append((clock.now_s - begin_s, pacer.late_s))
    return found


def test_the_real_clock_goes_forward_and_sleeping_takes_time() -> None:
    before_s = monotonic_s()
    sleep_s(0.01)
    assert monotonic_s() - before_s >= 0.01
    for nothing in (0.0, -5.0, float("nan")):
        sleep_s(nothing)
    assert abs(monotonic_s() - time.monotonic()) < 1.0


def test_laps_belong_to_their_stages_and_a_tick_is_their_sum() -> None:
    clock = ManualClock()
    watch: StopWatch = StopWatch(clock)
    meter: Meter = watch
    for tick in range(100):
        clock.now_s += 7.0  # between ticks: belongs to no stage
        watch.begin_tick()
        clock.now_s += 0.001
        meter.lap("world")
        clock.now_s += 0.002
        meter.lap("render")
        clock.now_s += 5.0
        watch.skip()  # waiting: belongs to no stage
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
    clock = ManualClock()
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
    clock = ManualClock()
    pacer = Pacer(0.0, clock, clock.sleep)
    pacer.start(0)
    pacer.wait_until(10_000_000)
    assert clock.slept == []


def test_simulated_time_follows_the_wall_clock_times_speed() -> None:
    clock = ManualClock()
    pacer = Pacer(2.0, clock, clock.sleep)
    pacer.start(5_000_000)
    for tick in range(1, 1001):
        pacer.wait_until(5_000_000 + 1000 * tick)
    # 1 s of simulated time at twice the speed
    assert clock.now_s - 100.0 == pytest.approx(0.5, abs=1e-9)
    assert pacer.worst_late_s == pytest.approx(0.0, abs=1e-9)


def test_a_long_first_tick_is_preparation_and_not_late() -> None:
    clock = ManualClock()
    pacer = Pacer(1.0, clock, clock.sleep)
    pacer.start(0)
    clock.now_s += 3.0
    pacer.wait_until(1000)
    pacer.wait_until(2000)
    assert (pacer.worst_late_s, pacer.slipped_s) == (0.0, 0.0)
    # time began when the preparation was over
    assert clock.now_s - 103.0 == pytest.approx(0.001)
    # and the same holds after each start
    pacer.start(0)
    clock.now_s += 3.0
    pacer.wait_until(1000)
    assert pacer.worst_late_s == 0.0


def test_the_first_wait_starts_a_pacer_that_was_not_started() -> None:
    clock = ManualClock()
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
    clock = ManualClock()
    pacer = Pacer(2.0, clock, clock.sleep)
    pacer.start(0)
    for tick in range(1, 301):
        if tick == 100:
            clock.now_s -= 3600.0
        if tick == 200:
            clock.now_s -= 0.5
        pacer.wait_until(1000 * tick)
    # no wait is longer than a tick, and together they are as long as simulated time
    assert max(clock.slept) == pytest.approx(0.0005)
    assert sum(clock.slept) == pytest.approx(0.15)
    assert pacer.went_back_s == pytest.approx(3600.5)
    assert pacer.report()["clock_back_s"] == pytest.approx(3600.5)
    assert (pacer.worst_late_s, pacer.slipped_s) == (pytest.approx(0.0, abs=1e-9), 0.0)


def test_several_ticks_may_be_waited_for_at_once() -> None:
    clock = ManualClock()
    pacer = Pacer(1.0, clock, clock.sleep)
    pacer.start(0)
    pacer.wait_until(1000)
    pacer.wait_until(9000)
    assert clock.slept == [pytest.approx(0.001), pytest.approx(0.008)]
    assert pacer.went_back_s == 0.0


def test_a_hiccup_below_catch_up_s_leaves_no_trace() -> None:
    clock = ManualClock()
    # the default of catch_up_s is long enough
    pacer = Pacer(1.0, clock, clock.sleep)
    times = ticking(clock, pacer, lambda tick: 0.08 if tick == 100 else 0.0, 1000)
    assert times[-1][0] == pytest.approx(1.0)
    assert (pacer.slips, pacer.slipped_s) == (0, 0.0)
    assert pacer.worst_late_s == pytest.approx(0.079)
    # 79 ms late, and 1 ms less in each tick after that
    assert sum(late > 1e-9 for _, late in times) == 79
    assert pacer.report()["late_ms"]["worst"] == pytest.approx(79, abs=1e-3)


def test_a_long_pause_slips_by_what_is_beyond_and_races_for_no_more_than_that() -> None:
    clock = ManualClock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.02)
    times = ticking(clock, pacer, lambda tick: 5.0 if tick == 100 else 0.0, 1000)
    assert pacer.slips == 1
    assert pacer.slipped_s == pytest.approx(5.0 - TICK_S - 0.02)
    assert times[-1][0] == pytest.approx(1.0 + pacer.slipped_s)
    walls = [wall for wall, _ in times]
    # after the pause, 20 ms of ticks are closer together than a tick, and no others ever
    fast = [k for k in range(100, 1000) if walls[k] - walls[k - 1] < 0.5 * TICK_S]
    assert len(fast) == 20
    assert fast[-1] < 125


def test_without_catching_up_no_tick_is_ever_shorter_than_real_time() -> None:
    clock = ManualClock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.0)
    times = ticking(clock, pacer, lambda tick: 0.003 if tick % 7 == 0 else 0.0004, 700)
    walls = [wall for wall, _ in times]
    assert min(b - a for a, b in pairwise(walls)) > TICK_S - 1e-9
    assert pacer.slips == 100
    assert pacer.slipped_s == pytest.approx(100 * 0.002)
    assert walls[-1] == pytest.approx(0.7 + pacer.slipped_s)


def test_a_machine_that_is_too_slow_slows_simulated_time_and_lateness_is_bounded() -> None:
    clock = ManualClock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.05)
    times = ticking(clock, pacer, lambda _: 0.002, 2000)
    # every tick happens, at half the speed, and is late by at most catch_up_s and a tick
    # (the excess of the first tick counts as preparation)
    assert times[-1][0] == pytest.approx(4.0)
    assert pacer.slipped_s == pytest.approx(4.0 - 2.0 - 0.05 - TICK_S)
    assert max(late for _, late in times) == pytest.approx(0.051)
    said = pacer.report()
    assert said["late_ms"]["median"] == pytest.approx(51, rel=0.01)
    assert said["slipped_s"] == pytest.approx(1.949)


def test_half_speed_slips_in_seconds_of_the_wall_clock() -> None:
    clock = ManualClock()
    pacer = Pacer(0.5, clock, clock.sleep, catch_up_s=0.0)
    times = ticking(clock, pacer, lambda tick: 0.012 if tick == 5 else 0.0, 10)
    assert pacer.slipped_s == pytest.approx(0.010)
    assert times[-1][0] == pytest.approx(0.030)


@pytest.mark.parametrize("catch_up_s", [-0.1, float("nan")])
def test_an_impossible_catch_up_is_refused(catch_up_s: float) -> None:
    with pytest.raises(EvsError, match="catch_up_s is"):
        Pacer(1.0, catch_up_s=catch_up_s)


@pytest.mark.property
@given(
    speed=st.sampled_from([0.1, 1.0, 3.0, 100.0]),
    catch_up_s=st.sampled_from([0.0, 0.01, 0.1]),
    start_s=st.sampled_from([0.0, 1e3, 1e7]),
    start_us=st.sampled_from([0, 2**31, 1_767_225_600_000_000]),
    told=st.booleans(),
    ticks=st.lists(st.tuples(_seconds, _steps_us, _seconds), max_size=60),
)
def test_a_clock_that_goes_forward_never_went_back(
    speed: float,
    catch_up_s: float,
    start_s: float,
    start_us: int,
    told: bool,
    ticks: list[tuple[float, int, float]],
) -> None:
    """The pacer never believes that a clock went back which only went forward.

    Args:
        speed: Simulated seconds per second of the wall clock.
        catch_up_s: The lateness that is caught up with.
        start_s: The wall clock at the start.
        start_us: The simulated time at the start.
        told: Whether the pacer is started explicitly, or by its first wait.
        ticks: For each tick, the work before it in s, its length in us, and by how much a sleep
            in it is too long, in s.
    """
    now, t_us, over_s = [start_s], start_us, [0.0]

    def sleep(wait_s: float) -> None:
        if wait_s > 0:
            now[0] += wait_s + over_s[0]

    pacer = Pacer(speed, lambda: now[0], sleep, catch_up_s=catch_up_s)
    if told:
        pacer.start(t_us)
    for work_s, step_us, late_s in ticks:
        now[0] += work_s
        t_us, over_s[0] = t_us + step_us, late_s
        pacer.wait_until(t_us)
    assert pacer.went_back_s == 0.0
