"""Rates of a stream over the last seconds: packets, events and bytes per second."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from evs.drivers.clock import monotonic_s


@dataclass(frozen=True)
class Rate:
    """Rates over one period of wall-clock time."""

    packets_hz: float
    events_hz: float
    bytes_hz: float
    """Bytes per second of raw frames: 16 an event."""
    shortest_s: float
    """Shortest time between two packets, s; NaN if there was none."""
    longest_s: float
    """Longest time between two packets, s; NaN if there was none."""
    packets: int
    """Packets in the period."""


class Rates:
    """Counts packets and returns their rates once per period."""

    def __init__(self, period_s: float = 1.0, clock: Callable[[], float] = monotonic_s) -> None:
        self._period_s, self._clock = period_s, clock
        self._begin_s = clock()
        self._last_s: float | None = None
        self._gaps_s: list[float] = []
        self._packets = self._events = self._bytes = 0

    def add(self, events: int, size_bytes: int) -> None:
        """Count one packet that arrived now."""
        now_s = self._clock()
        if self._last_s is not None:
            gap_s = now_s - self._last_s
            self._gaps_s = [min([gap_s, *self._gaps_s]), max([gap_s, *self._gaps_s])]
        self._last_s = now_s
        self._packets += 1
        self._events += events
        self._bytes += size_bytes

    @property
    def remaining_s(self) -> float:
        """Time until the period is over, s; zero or less when it is."""
        return self._begin_s + self._period_s - self._clock()

    def take(self) -> Rate:
        """Return the rates since the last call; a new period begins."""
        now_s = self._clock()
        elapsed_s = max(now_s - self._begin_s, 1e-9)
        shortest_s, longest_s = self._gaps_s or (math.nan, math.nan)
        rate = Rate(
            packets_hz=self._packets / elapsed_s,
            events_hz=self._events / elapsed_s,
            bytes_hz=self._bytes / elapsed_s,
            shortest_s=shortest_s,
            longest_s=longest_s,
            packets=self._packets,
        )
        self._begin_s = now_s
        self._packets = self._events = self._bytes = 0
        self._gaps_s = []
        return rate
