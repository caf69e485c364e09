"""The events of the last moments as points in a space of x, y and time."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from evs.msgs import Events

SPAN_US = 200_000
"""How far back a cloud reaches, simulated time."""


class EventCloud:
    """Gathers one camera's events; a cloud has `most` points at most, evenly thinned."""

    def __init__(self, most: int) -> None:
        """Start empty; `most` is 1 or more."""
        self._most = most
        self._parts: deque[Events] = deque()

    def add(self, events: Events) -> None:
        """Add a packet's events. A step back in time (a new run) starts over."""
        if not len(events):
            return
        if self._parts and events["t"][0] < self._parts[-1]["t"][-1]:
            self._parts.clear()
        # a copy: the memory of a packet may be used again
        self._parts.append(_thinned(events, self._most).copy())
        # a window may end before the packet that completes it
        while self._parts[0]["t"][-1] <= events["t"][-1] - 2 * SPAN_US:
            self._parts.popleft()

    def points(self, end_us: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
        """Return the events of (end_us - SPAN_US, end_us].

        Args:
            end_us: Simulated time, us.

        Returns:
            (n, 3) float32: x, px; y, px; age, ms, which is 0 at the end. (n,) bool: ON.
        """
        parts = [
            part[(part["t"] > end_us - SPAN_US) & (part["t"] <= end_us)] for part in self._parts
        ]
        count = sum(map(len, parts))
        places = np.zeros((0, 3), np.float32)
        if not count:
            return places, np.zeros(0, np.bool_)
        events = _thinned(np.concatenate(parts), self._most)
        age_ms = 1e-3 * (end_us - events["t"])
        places = np.stack([events["x"], events["y"], age_ms], axis=1).astype(np.float32)
        return places, events["p"].astype(np.bool_)


def _thinned(events: Events, most: int) -> Events:
    """At most this number of points, evenly chosen, the newest included."""
    if len(events) <= most:
        return events
    return events[np.arange(1, most + 1) * len(events) // most - 1]
