"""The Pareto front of measured points: those that no other is both faster and more accurate than.

Which error? EMD alone rewards silence: a model that fires nothing is closer to the truth, event for
event, than one that fires at the wrong time. Recall alone rewards noise, precision alone rewards
keeping quiet. So the figure is what recall and precision say together: of all events, those of the
point and those of converged light, the share that has no partner on its pixel within 3 ms. That is
1 - F1. Silence has 1, noise goes to 1, and 0.1 means one event in ten in every scene, while an EMD
of 0.1 events a pixel is much in one and nothing in another. EMD can be asked for instead, and
stands beside it in every table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from evs.msgs import unknown
from evs.tools.sweep.measured import OURS, Error, Measured


@dataclass(frozen=True)
class Figure:
    """One number for how far off events are. The smaller the better."""

    name: str
    words: str
    """what it is, for an axis"""
    of: Callable[[Error], float]
    """NaN: not defined"""
    own: Callable[[Error], float]
    """what the reference itself may be off by: nobody can be seen to be better than that"""


def unmatched(recall: float, precision: float) -> float:
    """Share of the events of two streams that have no partner in the other: 1 - F1.

    A share of no events is NaN: without any event recall alone tells (all is missed), without any
    in the reference precision does (all are false). NaN: neither has any.
    """
    known = [share for share in (recall, precision) if math.isfinite(share)]
    if not known:
        return math.nan
    if len(known) == 1 or not recall + precision:
        return 1.0 - min(known)
    return 1.0 - 2.0 * recall * precision / (recall + precision)


# one half of the converged light against the other differs by twice what their mean is off by,
# and the halves have as many events, so recall is precision there
FIGURES = {
    figure.name: figure
    for figure in (
        Figure(
            "unmatched",
            "share of events without a partner within 3 ms",
            lambda error: unmatched(error.recall, error.precision),
            lambda error: 0.5 * (1.0 - error.recall_reference),
        ),
        Figure(
            "emd",
            "EMD, events a pixel",
            lambda error: error.emd,
            lambda error: 0.5 * error.emd_reference,
        ),
    )
}
DEFAULT = FIGURES["unmatched"]


def figure_named(name: str) -> Figure:
    """Raises EvsError for a name that is none."""
    if name not in FIGURES:
        raise unknown("figure of error", name, FIGURES)
    return FIGURES[name]


@dataclass(frozen=True)
class Spot:
    """A record that has both a speed and an error."""

    record: Measured
    speed: float
    """real-time factor, median over repeats"""
    error: float
    """of a figure, as measured"""
    own: float
    """the reference's own; 0 where it is not known"""

    @property
    def seen(self) -> float:
        """The error as far as the reference can tell: never below its own."""
        return max(self.error, self.own)

    @property
    def comparable(self) -> bool:
        """Whether it is the same sensor as all others: with another, other events are asked for."""
        return not any(key.startswith("sensor.") for key in self.record.settings)

    def dominates(self, other: Spot) -> bool:
        """No slower, no less accurate, and one of the two better."""
        no_worse = self.speed >= other.speed and self.seen <= other.seen
        return no_worse and (self.speed > other.speed or self.seen < other.seen)


def spots(records: Iterable[Measured], figure: Figure = DEFAULT) -> list[Spot]:
    """Every record that has both, in their order; what is not defined is left out."""
    found = []
    for record in records:
        if record.speed is None or record.error is None:
            continue
        speed, error = record.speed.real_time_factor.median, figure.of(record.error)
        own = figure.own(record.error)
        if math.isfinite(speed) and speed > 0.0 and math.isfinite(error):
            found.append(Spot(record, speed, error, own if math.isfinite(own) else 0.0))
    return found


def front(every: Sequence[Spot], kind: str = OURS) -> list[Spot]:
    """Those of a kind that none of its kind dominates, the fastest first. Of equals the first.

    Only of those with the same sensor.
    """
    # from the fastest on, one is on the front where it is more accurate than all before it
    able = [spot for spot in every if spot.record.kind == kind and spot.comparable]
    ordered = sorted(able, key=lambda spot: (-spot.speed, spot.seen))
    best = math.inf
    kept = []
    for spot in ordered:
        if spot.seen < best:
            best = spot.seen
            kept.append(spot)
    return kept


def cases(records: Iterable[Measured]) -> dict[tuple[str, str], list[Measured]]:
    """(scene, camera) -> its records. Points of two cases are never compared."""
    found: dict[tuple[str, str], list[Measured]] = {}
    for record in records:
        found.setdefault((record.scene, record.camera), []).append(record)
    return found
