"""Yardstick: a fixed piece of work, timed beside every repeat: the speed of the machine now.

It is NumPy and nothing of ours, on one thread, so it stays the same when evs becomes faster. The
time of a tick is given as a ratio to it, which can be compared between machines and hours.
"""

from __future__ import annotations

import numpy as np

from evs.drivers.clock import monotonic_s

DESCRIPTION = (
    "NumPy: logarithm, sort, sum of 346 x 260 floats 8 times, one thread, beside every repeat"
)

_SHAPE = 260, 346
_PASSES = 8
_RUNS = 3


class Yardstick:
    """Its numbers are made once; `measure_s` works through them."""

    def __init__(self) -> None:
        drawn = np.random.Philox(key=7).random_raw(_SHAPE[0] * _SHAPE[1])
        self._numbers = (drawn.reshape(_SHAPE) / 2.0**64 + 0.5).astype(np.float32)
        self.measure_s()

    def measure_s(self) -> float:
        """Wall clock of the work, some 1 ms, in s: the median of three."""
        return sorted(self._once_s() for _ in range(_RUNS))[_RUNS // 2]

    def _once_s(self) -> float:
        begin_s = monotonic_s()
        for _ in range(_PASSES):
            log = np.log(self._numbers)
            log.sort(axis=1)
            np.sum(log * log, dtype=np.float64)
        return monotonic_s() - begin_s
