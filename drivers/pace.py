"""The one door to the wall clock: how long stages take, and when a tick may leave."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from evs.msgs import EvsError


def monotonic_s() -> float:
    """Seconds of a clock that never goes back; only differences mean something."""
    return time.monotonic()


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

    Runs of hours have millions of ticks. Out: quantiles right to 0.5 %; below 1 ns counts as zero.
    """

    _WIDTH = math.log(1.01)
    _FLOOR_S = 1e-9

    def __init__(self) -> None:
        self.counts: dict[int, int] = {}
        """bin -> how many; bin -1 holds the zeros, bin b holds [1.01^b, 1.01^(b+1)) ns"""
        self.total = 0

    def add(self, seconds: float) -> None:
        """Count one duration, s."""
        zero = not seconds >= self._FLOOR_S
        place = -1 if zero else int(math.log(seconds / self._FLOOR_S) / self._WIDTH)
        self.counts[place] = self.counts.get(place, 0) + 1
        self.total += 1

    def quantile_s(self, share: float) -> float:
        """The duration, s, that a `share` (0 ... 1) of all do not exceed; 0.0 if there are none."""
        wanted = max(1, math.ceil(share * self.total - 1e-9))
        seen = 0
        for place in sorted(self.counts):
            seen += self.counts[place]
            if seen >= wanted:
                # the middle of the bin, so that the error is half its width either way
                return 0.0 if place < 0 else self._FLOOR_S * math.exp((place + 0.5) * self._WIDTH)
        return 0.0


class StopWatch:
    """Per-stage, per-tick times. It is the Meter that the emulator laps.

    begin_tick, any number of laps (a stage may be lapped more than once a tick), end_tick.
    Time between end_tick and begin_tick belongs to nobody.
    """

    def __init__(self, clock: Callable[[], float] = monotonic_s) -> None:
        self._clock = clock
        self._last_s = clock()
        self._tick: dict[str, float] = {}
        self._stages: dict[str, Durations] = {}

    def begin_tick(self) -> None:
        """The tick's first stage starts now."""
        self._tick = {}
        self._last_s = self._clock()

    def lap(self, stage: str) -> None:
        """The time since the previous lap belongs to `stage`."""
        now_s = self._clock()
        self._tick[stage] = self._tick.get(stage, 0.0) + (now_s - self._last_s)
        self._last_s = now_s

    def skip(self) -> None:
        """The time since the previous lap belongs to nobody (waiting for the pace)."""
        self._last_s = self._clock()

    def end_tick(self) -> None:
        """Count the tick. A stage that was not lapped in it has no sample."""
        for stage, seconds in self._tick.items():
            self._stages.setdefault(stage, Durations()).add(seconds)
        self._tick = {}

    def stage_ms(self, stages: Iterable[str] = ()) -> dict[str, StageTime]:
        """Median and 99th percentile, ms per tick: `stages` in their order, then all others."""
        names = dict.fromkeys([*stages, *self._stages])
        nothing = Durations()
        return {
            name: StageTime(
                median=round(1e3 * self._stages.get(name, nothing).quantile_s(0.5), 6),
                p99=round(1e3 * self._stages.get(name, nothing).quantile_s(0.99), 6),
            )
            for name in names
        }


class Pacer:
    """Holds simulated time back to `speed` times the wall clock; 0 holds nothing back.

    A late tick is not waited for and the next ones catch up, so the mean speed holds.
    """

    def __init__(
        self,
        speed: float = 0.0,
        clock: Callable[[], float] = monotonic_s,
        sleep: Callable[[float], None] = sleep_s,
    ) -> None:
        if not (math.isfinite(speed) and speed >= 0):
            raise EvsError(f"speed {speed} is not possible: give a number over 0, or 0 for free")
        self._speed, self._clock, self._sleep = speed, clock, sleep
        self._start_s = 0.0
        self._start_us = 0
        self._started = False
        self.late_s = 0.0
        """how far the latest tick was behind its time, s"""
        self.worst_late_s = 0.0

    def start(self, t_us: int) -> None:
        """Simulated time t_us is now."""
        self._start_s, self._start_us, self._started = self._clock(), t_us, True

    def wait_until(self, t_us: int) -> None:
        """Return when the wall clock has reached simulated time t_us; the first starts it."""
        if self._speed == 0:
            return
        if not self._started:
            self.start(t_us)
        due_s = self._start_s + (t_us - self._start_us) * 1e-6 / self._speed
        early_s = due_s - self._clock()
        self.late_s = max(0.0, -early_s)
        self.worst_late_s = max(self.worst_late_s, self.late_s)
        self._sleep(early_s)
