"""The readout, from any recording with many events: its order, its scan, its limit."""

from __future__ import annotations

import math

import numpy as np

from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.observed import F64, I64, Observed

KEYS = ("readout.order", "readout.scan_us", "readout.scan_column_ns", "readout.bandwidth_mevs")

FEWEST_PAIRS = 300
"""of successive events with one stamp"""

NEAR_US = 20
"""between successive events that such pairs are compared with"""

SURE = 3.0
"""by what factor such pairs must share a row, or a column, more often than those"""

MOST_INTERVALS = 4000
LONGEST_SCAN_US = 5000
SHORTEST_SCAN_US = 20
ON_GRID = 0.9
"""mean cosine of the phases of intervals that are multiples of a period, within 1 or 2 us"""

SAME = 0.99
"""length of the mean direction of phases that are all the same"""

WINDOW_US = 1000
FEWEST_FULL = 10
"""windows that a limit of the rate has filled"""

FULL = 0.01
"""a window is full if it has so much less than the fullest at most"""


def fit_readout(seen: Observed) -> list[Estimate]:
    """Fit all of it; what cannot be told says so."""
    period_us = _scan_period_us(seen)
    if period_us and _stamp_grid(seen, period_us):
        reason = f"all its stamps are multiples of {period_us} us"
        return [*(cannot(key, seen.source, reason) for key in KEYS[:3]), _bandwidth(seen)]
    return [_order(seen, period_us), *_scan(seen, period_us), _bandwidth(seen)]


def _order(seen: Observed, period_us: int) -> Estimate:
    if period_us:
        return Estimate(KEYS[0], "scan", source=seen.source)
    t_us, x, y = (seen.events[name].astype(np.int64) for name in "txy")
    steps = np.diff(t_us)
    same, next_to = steps == 0, (steps > 0) & (steps <= NEAR_US)
    count = int(same.sum())
    if min(count, int(next_to.sum())) < FEWEST_PAIRS:
        return cannot(KEYS[0], seen.source, f"{count} pairs of successive events have one stamp")
    # what moves in a view is in few rows and columns, for pairs of other stamps too
    row, column = (
        float(np.mean(shared[same])) / max(float(np.mean(shared[next_to])), 1e-4)
        for shared in (np.diff(y) == 0, np.diff(x) == 0)
    )
    found = f"events with one stamp share a row {row:.2g} times as often as others that are near"
    if row > SURE and row > column:
        return Estimate(KEYS[0], "arbiter", source=seen.source, note=found)
    # busy streams of a fast arbiter look so too: nothing shows that a readout is ideal
    return cannot(KEYS[0], seen.source, f"{found}: no order shows")


def _scan_period_us(seen: Observed) -> int:
    """Period that the intervals of a pixel are multiples of; 0: there is none."""
    lengths = seen.intervals.length_us
    if len(lengths) < FEWEST_PAIRS:
        return 0
    # whole multiples of a period that is only nearly known drift apart: short intervals first
    short = np.sort(lengths)[: max(FEWEST_PAIRS, len(lengths) // 2)]
    step = max(1, len(short) // MOST_INTERVALS)
    some = short[::step].astype(np.float64)
    shortest = float(np.quantile(some, 0.02))
    best, best_period = ON_GRID, 0
    for period in range(min(LONGEST_SCAN_US, int(shortest) + 2), SHORTEST_SCAN_US - 1, -1):
        strength = float(np.mean(np.cos(2.0 * math.pi / period * some)))
        if strength > best:
            best, best_period = strength, period
        elif best_period and strength < ON_GRID:
            # fractions of a period are no longer looked at
            break
    return best_period if _varied(np.round(some / max(best_period, 1)).astype(np.int64)) else 0


def _stamp_grid(seen: Observed, period_us: int) -> bool:
    """Whether all stamps are multiples of the period, of all columns and rows."""
    phase = 2.0 * math.pi * (seen.events["t"] % period_us) / period_us
    return float(abs(np.mean(np.exp(1j * phase)))) > SAME


def _varied(multiples: I64) -> bool:
    """Whether the multiples are many: one interval alone is a multiple of anything."""
    _, counts = np.unique(multiples, return_counts=True)
    return len(counts) >= 5 and float(counts.max() / counts.sum()) < 0.7


def _scan(seen: Observed, period_us: int) -> list[Estimate]:
    if not period_us:
        reason = "the intervals of a pixel are no multiples of a period"
        return [cannot(key, seen.source, reason) for key in KEYS[1:3]]
    phase = 2.0 * math.pi * (seen.events["t"] % period_us) / period_us
    step = max(1, len(phase) // 20_000)
    phase, x = phase[::step], seen.events["x"][::step].astype(np.float64)
    # columns follow each other at an even pace inside a scan
    paces = np.linspace(0.0, period_us / seen.width, 801)

    def agreement(pace_us: float) -> float:
        return float(abs(np.mean(np.exp(1j * (phase - 2.0 * math.pi * pace_us / period_us * x)))))

    strength = np.array([agreement(float(pace)) for pace in paces])
    best = int(strength.argmax())
    spread_us = period_us / (2.0 * math.pi) * math.sqrt(max(-2.0 * math.log(strength[best]), 1e-9))
    per_column = math.sqrt(12.0 / len(x)) / seen.width
    error_ns = 1e3 * math.hypot(spread_us * per_column, float(paces[1]) / math.sqrt(12.0))
    scan = Estimate(KEYS[1], float(period_us), 0.3, seen.source)
    if strength[best] < ON_GRID:
        return [scan, cannot(KEYS[2], seen.source, "columns are not read at an even pace")]
    return [scan, Estimate(KEYS[2], 1e3 * float(paces[best]), error_ns, seen.source)]


def _bandwidth(seen: Observed) -> Estimate:
    """A limit shows as many windows that are equally full."""
    t_us = seen.events["t"].astype(np.int64)
    # windows without events need no memory
    windows, numbers = np.unique((t_us - t_us[0]) // WINDOW_US, return_counts=True)
    counts: F64 = numbers.astype(np.float64)
    most = float(counts.max())
    full = counts[counts >= (1.0 - FULL) * most]
    rate = f"no more than {most / WINDOW_US:.3g} Mev/s in {WINDOW_US // 1000} ms, without a limit"
    # by chance, counts of this size differ by more than FULL
    if len(full) < FEWEST_FULL or most < 4.0 / FULL or len(full) > 0.5 * (windows[-1] + 1):
        return cannot(KEYS[3], seen.source, rate)
    below = counts[(counts >= (1.0 - 3.0 * FULL) * most) & (counts < (1.0 - FULL) * most)]
    if len(below) > 0.3 * len(full):
        return cannot(KEYS[3], seen.source, rate)
    value = float(full.mean()) / WINDOW_US
    error = max(float(full.std()) / math.sqrt(len(full)), 1.0) / WINDOW_US
    return Estimate(KEYS[3], value, error, seen.source)
