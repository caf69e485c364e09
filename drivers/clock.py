"""The one door to the wall clock: how long stages take, and when a tick may leave."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from evs.msgs import EvsError

monotonic_s = time.monotonic
"""() -> seconds of a clock that never goes back; only differences mean something."""


def process_cpu_s() -> float:
    """CPU seconds of all threads of this process so far; only differences mean something."""
    return time.process_time()


def sleep_s(seconds: float) -> None:
    """Sleep; not at all for zero, negative or NaN."""
    if seconds > 0:
        time.sleep(seconds)


@dataclass(frozen=True)
class StageTime:
    """Milliseconds that one stage took per tick."""

    median: float
    p99: float


class Durations:
    """Quantiles of any number of durations in bounded memory: counts in bins 1 % wide.

    Runs of hours have millions of ticks. Quantiles are right to 0.5 %; below 1 ns counts as zero.
    """

    _WIDTH = math.log(1.01)
    _FLOOR_S = 1e-9
    _MOST_NEW = 100

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        self._new: list[float] = []
        """not in a bin yet: sorting in many at once takes a third of the time"""

    def add(self, seconds: float) -> None:
        """Count one duration, s."""
        self._new.append(seconds)
        if len(self._new) == self._MOST_NEW:
            self._sort_in()

    @property
    def counts(self) -> dict[int, int]:
        """Bin -> how many; bin -1 holds the zeros, bin b holds [1.01^b, 1.01^(b+1)) ns."""
        self._sort_in()
        return self._counts

    @property
    def total(self) -> int:
        """The total count."""
        return sum(self.counts.values())

    def quantile_s(self, share: float) -> float:
        """Return the duration, s, that a `share` (0 ... 1) of all do not exceed; 0.0 for none."""
        counts = self.counts
        wanted = max(1, math.ceil(share * self.total - 1e-9))
        seen = 0
        for place in sorted(counts):
            seen += counts[place]
            if seen >= wanted:
                # the middle of the bin, so that the error is half its width either way
                return 0.0 if place < 0 else self._FLOOR_S * math.exp((place + 0.5) * self._WIDTH)
        return 0.0

    def _sort_in(self) -> None:
        counts = self._counts
        for seconds in self._new:
            zero = not seconds >= self._FLOOR_S
            place = -1 if zero else int(math.log(seconds / self._FLOOR_S) / self._WIDTH)
            counts[place] = counts.get(place, 0) + 1
        self._new.clear()


class _Hand:
    """The state of a stop watch in one thread: the tick and its last lap."""

    __slots__ = ("last_s", "tick")

    def __init__(self) -> None:
        self.tick: dict[str, float] = {}
        self.last_s = 0.0


class _Hands(threading.local):
    """Each thread's own state; read once a lap, since each access takes its time."""

    def __init__(self) -> None:
        self.own = _Hand()


class StopWatch:
    """Per-stage, per-tick times. It is the Meter that the emulator laps.

    begin_tick, any number of laps (a stage may be lapped more than once a tick), end_tick.
    Time between end_tick and begin_tick belongs to no stage. Each thread has its own state; a stage
    belongs to one thread.
    """

    def __init__(self, clock: Callable[[], float] = monotonic_s) -> None:
        self._clock = clock
        self._hands = _Hands()
        self._stages: dict[str, Durations] = {}

    def begin_tick(self) -> None:
        """The tick's first stage starts now."""
        hand = self._hands.own
        hand.tick = {}
        hand.last_s = self._clock()

    def lap(self, stage: str) -> None:
        """The time since the previous lap belongs to `stage`."""
        hand = self._hands.own
        now_s = self._clock()
        tick = hand.tick
        tick[stage] = tick.get(stage, 0.0) + (now_s - hand.last_s)
        hand.last_s = now_s

    def so_far_s(self, stage: str) -> float:
        """Seconds that a stage has taken in the tick that the calling thread is in."""
        return self._hands.own.tick.get(stage, 0.0)

    def skip(self) -> None:
        """The time since the previous lap belongs to no stage (waiting for the pace)."""
        self._hands.own.last_s = self._clock()

    def end_tick(self) -> None:
        """Count the tick. A stage that was not lapped in it has no sample."""
        hand = self._hands.own
        for stage, seconds in hand.tick.items():
            if stage not in self._stages:
                self._stages[stage] = Durations()
            self._stages[stage].add(seconds)
        hand.tick = {}

    def stage_ms(self, stages: Iterable[str] = ()) -> dict[str, StageTime]:
        """Return median and 99th percentile, ms per tick: `stages` in order, then all others."""
        names = dict.fromkeys([*stages, *self._stages])
        nothing = Durations()
        return {
            name: StageTime(
                median=round(1e3 * self._stages.get(name, nothing).quantile_s(0.5), 6),
                p99=round(1e3 * self._stages.get(name, nothing).quantile_s(0.99), 6),
            )
            for name in names
        }


CATCH_UP_S = 0.1
"""Default of the lateness that the next ticks make up for, s: a hiccup, not an overload."""


_CLOCK_STEP_S = 1e-3
"""A clock that goes back by less is only coarse: the pacer waits for it."""


class Pacer:
    """Holds simulated time back to `speed` times the wall clock; 0 holds nothing back.

    After a tick that is late by up to `catch_up_s` the next ticks do not wait, so that the mean
    speed holds. Lateness beyond that is given up: simulated time slips behind the wall clock for
    good. The run slows down; no tick is left out.

    The pacer does not wait for a clock that goes back, which none should: no wait is longer than
    the ticks since the last one.
    """

    def __init__(
        self,
        speed: float = 0.0,
        clock: Callable[[], float] = monotonic_s,
        sleep: Callable[[float], None] = sleep_s,
        *,
        catch_up_s: float = CATCH_UP_S,
    ) -> None:
        if not (math.isfinite(speed) and speed >= 0):
            raise EvsError(f"speed {speed} is not possible: give a number above 0, or 0 for free")
        if not catch_up_s >= 0:
            raise EvsError(
                f"catch_up_s is {catch_up_s}: give the lateness to catch up with, 0 s on"
            )
        self.speed, self.catch_up_s = speed, catch_up_s
        self._clock, self._sleep = clock, sleep
        self._start_s = 0.0
        self._start_us = 0
        self._started = False
        self._waited = False
        self.late_s = 0.0
        """how far the latest tick was behind its time, s"""
        self.worst_late_s = 0.0
        self.lateness = Durations()
        """of every tick"""
        self.slipped_s = 0.0
        """by how much simulated time has slipped behind the wall clock so far, s of that clock"""
        self.slips = 0
        """in how many ticks"""
        self.went_back_s = 0.0
        """by how much the clock has gone back so far, s, at least"""
        self._last_us = 0

    def now_s(self) -> float:
        """Return the time of its clock, s."""
        return self._clock()

    def start(self, t_us: int) -> None:
        """Set simulated time t_us to now.

        If the first tick takes too long, that is preparation (light is traced for the first time)
        and no lateness: time then begins at its end.
        """
        self._start_s, self._start_us, self._started = self._clock(), t_us, True
        self._last_us, self._waited = t_us, False

    def wait_until(self, t_us: int) -> None:
        """Return when the wall clock has reached simulated time t_us; the first starts it."""
        if self.speed == 0:
            return
        if not self._started:
            self.start(t_us)
        due_s = self._start_s + (t_us - self._start_us) * 1e-6 / self.speed
        early_s = due_s - self._clock()
        # the last wait ended when its own time had come, so at most this much is left
        most_s = (t_us - self._last_us) * 1e-6 / self.speed
        self._last_us = t_us
        if early_s > most_s + _CLOCK_STEP_S:
            self._start_s -= early_s - most_s
            self.went_back_s += early_s - most_s
            early_s = most_s
        if not self._waited:
            self._waited = True
            self._start_s += max(0.0, -early_s)
            early_s = max(0.0, early_s)
        self.late_s = max(0.0, -early_s)
        self.worst_late_s = max(self.worst_late_s, self.late_s)
        self.lateness.add(self.late_s)
        if self.late_s > self.catch_up_s:
            slip_s = self.late_s - self.catch_up_s
            self._start_s += slip_s
            self.slipped_s += slip_s
            self.slips += 1
        self._sleep(early_s)

    def report(self) -> dict[str, Any]:
        """Return how the pace was held, for the run report; empty where nothing was held back."""
        if self.speed == 0:
            return {}
        late_ms = {
            "median": round(1e3 * self.lateness.quantile_s(0.5), 6),
            "p99": round(1e3 * self.lateness.quantile_s(0.99), 6),
            "worst": round(1e3 * self.worst_late_s, 6),
        }
        return {
            "speed": self.speed,
            "catch_up_s": self.catch_up_s,
            "late_ms": late_ms,
            "slipped_s": round(self.slipped_s, 6),
            "slips": self.slips,
            "clock_back_s": round(self.went_back_s, 6),
        }
