"""Statistics of a stream of events, and how far those of two streams are apart.

The streams may show different scenes, so a distance alone tells nothing: it is set beside that
between two pieces of real recordings of one camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from evs.msgs import EvsError
from evs_lab.fit import Observed
from evs_lab.fit.observed import F64, I64, Mask

BINS_PER_DECADE = 10
INTERVAL_EDGES_US: F64 = np.geomspace(1.0, 1e9, 9 * BINS_PER_DECADE + 1)

BURST_US = 20_000
"""longest interval inside a burst: a run of events of one pixel and polarity"""
BURST_EDGES: F64 = np.append(2.0 ** (np.arange(40) / 4.0), np.inf)

RATE_BINS = 1 + 6 * BINS_PER_DECADE
"""silent pixels, then counts of 1 ... 1e6"""

STAMP_US, STAMP_BINS = 1000, 50
"""a packet of most drivers; bins of it"""

NEAR_US = 5000
"""how far apart events are that support each other, in a filter of background activity"""

FEWEST_EVENTS = 1000
"""of a piece of a recording, for its statistics to tell anything"""


@dataclass(frozen=True)
class Statistics:
    """A piece of a recording."""

    seen: Observed
    begin_us: int
    """itself not inside"""
    seconds: float

    @cached_property
    def intervals(self) -> F64:
        """Distribution of the intervals of a pixel, in tenths of a decade from 1 us."""
        length = self.seen.intervals.length_us.astype(np.float64)
        return _share(np.histogram(np.maximum(length, 1.0), INTERVAL_EDGES_US)[0])

    @cached_property
    def rates(self) -> F64:
        """Distribution of the pixels' counts: silent ones, then in tenths of a decade from 1."""
        counts = self.seen.on_counts + self.seen.off_counts
        some = counts[counts > 0]
        bins = 1 + (BINS_PER_DECADE * np.log10(some)).astype(np.int64)
        shares = np.bincount(np.minimum(bins, RATE_BINS - 1), minlength=RATE_BINS)
        shares[0] = len(counts) - len(some)
        return _share(shares)

    @cached_property
    def bursts(self) -> F64:
        """Distribution of the lengths of bursts, in quarters of a doubling."""
        every = self.seen.intervals
        # a burst is longer by one than the run of intervals in it
        joined = (every.length_us <= BURST_US) & (every.before_on == every.after_on)
        # intervals that follow one another share an event
        follows = np.append(False, every.begin_us[1:] == every.begin_us[:-1] + every.length_us[:-1])
        follows &= np.append(False, every.pixel[1:] == every.pixel[:-1])
        first = joined & ~(follows & np.append(False, joined[:-1]))
        run = np.bincount(np.cumsum(first)[joined] - 1, minlength=int(first.sum()))
        alone = len(self.seen.events) - int(run.sum()) - len(run)
        return _share(np.histogram(np.append(run + 1, np.ones(alone)), BURST_EDGES)[0])

    @cached_property
    def stamps(self) -> F64:
        """Distribution of time stamps inside a millisecond."""
        inside = self.seen.events["t"].astype(np.int64) % STAMP_US
        return _share(np.bincount(inside * STAMP_BINS // STAMP_US, minlength=STAMP_BINS))

    @property
    def rate_hz(self) -> float:
        """Mean rate of a pixel."""
        return len(self.seen.events) / self.seconds / self.seen.pixels

    @cached_property
    def active(self) -> float:
        """Share of pixels with an event."""
        return float(np.mean(self.seen.on_counts + self.seen.off_counts > 0))

    @cached_property
    def on(self) -> float:
        """Share of ON events."""
        return float(self.seen.on.mean())

    @cached_property
    def flips(self) -> float:
        """Share of a pixel's successive events that differ in polarity."""
        every = self.seen.intervals
        return _mean(every.before_on != every.after_on)

    @cached_property
    def same_stamp(self) -> float:
        """Share of successive events with one stamp."""
        return _mean(self._same_stamp)

    @cached_property
    def same_row(self) -> float:
        """Share of successive events with one stamp that are in one row."""
        return _mean(self._same_row[self._same_stamp])

    @cached_property
    def ascending(self) -> float:
        """Share of successive events with one stamp and row whose column rises."""
        x = self.seen.events["x"].astype(np.int64)
        return _mean((np.diff(x) > 0)[self._same_stamp & self._same_row])

    @cached_property
    def supported(self) -> float:
        """Share of events with another on the eight pixels around, in the same 5 ms."""
        events = self.seen.events
        slot = events["t"].astype(np.int64) // NEAR_US
        width, height = self.seen.width + 2, self.seen.height + 2
        cell = (slot * height + events["y"] + 1) * width + events["x"] + 1
        taken = np.unique(cell)
        found = np.zeros(len(cell), bool)
        for step in (-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1):
            place = np.searchsorted(taken, cell + step)
            found |= taken[np.minimum(place, len(taken) - 1)] == cell + step
        return _mean(found)

    @cached_property
    def _same_stamp(self) -> Mask:
        return np.asarray(np.diff(self.seen.events["t"].astype(np.int64)) == 0)

    @cached_property
    def _same_row(self) -> Mask:
        return np.asarray(np.diff(self.seen.events["y"].astype(np.int64)) == 0)


@dataclass(frozen=True)
class Quantity:
    """One column of the table."""

    key: str
    name: str
    unit: str
    """of the distance"""
    low: float | None = field(default=None)
    """None: the distance is that of two numbers; else one of distributions, in steps of `low`"""


QUANTITIES = (
    Quantity("rate_hz", "events per pixel and second", "decades"),
    Quantity("active", "pixels with events", ""),
    Quantity("rates", "counts of pixels", "decades", 1.0 / BINS_PER_DECADE),
    Quantity("intervals", "intervals of a pixel", "decades", 1.0 / BINS_PER_DECADE),
    Quantity("bursts", "lengths of bursts", "doublings", 0.25),
    Quantity("on", "ON share", ""),
    Quantity("flips", "changes of polarity", ""),
    Quantity("supported", "events with a neighbour", ""),
    Quantity("stamps", "stamps inside 1 ms", "", 0.0),
    Quantity("same_stamp", "events on the stamp of the one before", ""),
    Quantity("same_row", "of these, in its row", ""),
    Quantity("ascending", "of these, with a higher x", ""),
)


def distance(quantity: Quantity, first: Statistics, second: Statistics) -> float:
    """How far two pieces are apart in one quantity; NaN where one of them does not have it.

    Distributions on a logarithmic axis: the earth mover's distance. Stamps, which go round: half of
    the sum of differences. Rates: of their logarithms. Shares: the difference.
    """
    a, b = getattr(first, quantity.key), getattr(second, quantity.key)
    if quantity.low is None:
        if quantity.key == "rate_hz":
            return float(abs(np.log10(a / b)))
        return float(abs(a - b))
    if quantity.low == 0.0:
        return float(0.5 * np.abs(a - b).sum())
    return float(quantity.low * np.abs(np.cumsum(a - b)).sum())


def pieces(seen: Observed, seconds: float) -> list[Statistics]:
    """As many pieces of a length as the recording holds, from its first event on.

    Raises:
        EvsError: A piece has too few events.
    """
    t = seen.events["t"].astype(np.int64)
    length_us = round(1e6 * seconds)
    found = []
    for k in range(max(int((t[-1] - t[0] + 1) // length_us), 1)):
        begin = int(t[0]) - 1 + k * length_us
        inside = np.searchsorted(t, [begin, begin + length_us], side="right")
        events = seen.events[inside[0] : inside[1]]
        if len(events) < FEWEST_EVENTS:
            raise EvsError(
                f"{seen.source} has {len(events)} events in {seconds:.3g} s; statistics take "
                f"{FEWEST_EVENTS}. Give a longer recording"
            )
        piece = Observed(events, seen.width, seen.height, seen.source)
        found.append(Statistics(piece, begin, seconds))
    return found


def _share(counts: I64) -> F64:
    return np.asarray(counts / max(int(counts.sum()), 1), np.float64)


def _mean(flags: Mask) -> float:
    return float(np.mean(flags)) if len(flags) else float("nan")
