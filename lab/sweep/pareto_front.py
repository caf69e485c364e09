"""The Pareto front: the measured points that no other point dominates in speed and accuracy.

Which error? EMD alone rewards silence: a model that fires nothing can be closer to the reference
than one that fires at the wrong time. Recall alone rewards noise, precision alone rewards silence.
So the default metric is 1 - F1: of all events, those of the point and those of converged light, the
share without a partner on its pixel within 3 ms. Silence has 1, noise approaches 1, and 0.1 means
one event in ten in every scene, while an EMD of 0.1 events per pixel is large in one scene and
small in another. EMD can be chosen instead, and every table shows both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from evs.msgs import unknown
from evs_lab.sweep.record import OURS, Accuracy, SweepRecord


@dataclass(frozen=True)
class ErrorMetric:
    """One number for the error of a stream of events; smaller is better."""

    name: str
    label: str
    """what it is, for an axis"""
    of: Callable[[Accuracy], float]
    """NaN: not defined"""
    reference_error: Callable[[Accuracy], float]
    """error of the reference itself, below which no point can be measured"""


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
ERROR_METRICS = {
    metric.name: metric
    for metric in (
        ErrorMetric(
            "unmatched",
            "share of events without a partner within 3 ms",
            lambda error: unmatched(error.recall, error.precision),
            lambda error: 0.5 * (1.0 - error.recall_reference),
        ),
        ErrorMetric(
            "emd",
            "EMD, events per pixel",
            lambda error: error.emd,
            lambda error: 0.5 * error.emd_reference,
        ),
    )
}
DEFAULT = ERROR_METRICS["unmatched"]


def error_metric(name: str) -> ErrorMetric:
    """Raises EvsError for a name that is none."""
    if name not in ERROR_METRICS:
        raise unknown("figure of error", name, ERROR_METRICS)
    return ERROR_METRICS[name]


@dataclass(frozen=True)
class ParetoPoint:
    """A record that has both a speed and an error."""

    record: SweepRecord
    speed: float
    """real-time factor, median over repeats"""
    error: float
    """of a figure, as measured"""
    reference_error: float
    """the reference's own; 0 where it is not known"""

    @property
    def visible_error(self) -> float:
        """The error, but not below that of the reference."""
        return max(self.error, self.reference_error)

    @property
    def comparable(self) -> bool:
        """Whether it uses the sensor of the preset; other sensors should give other events."""
        return not any(key.startswith("sensor.") for key in self.record.settings)

    def dominates(self, other: ParetoPoint) -> bool:
        """No slower, no less accurate, and one of the two better."""
        no_worse = self.speed >= other.speed and self.visible_error <= other.visible_error
        return no_worse and (self.speed > other.speed or self.visible_error < other.visible_error)


def pareto_points(
    records: Iterable[SweepRecord], metric: ErrorMetric = DEFAULT
) -> list[ParetoPoint]:
    """Every record that has both, in their order; what is not defined is left out."""
    found = []
    for record in records:
        if record.speed is None or record.error is None:
            continue
        speed, error = record.speed.real_time_factor.median, metric.of(record.error)
        reference_error = metric.reference_error(record.error)
        if math.isfinite(speed) and speed > 0.0 and math.isfinite(error):
            found.append(
                ParetoPoint(
                    record, speed, error, reference_error if math.isfinite(reference_error) else 0.0
                )
            )
    return found


def pareto_front(every: Sequence[ParetoPoint], kind: str = OURS) -> list[ParetoPoint]:
    """The points of a kind that no point of that kind dominates, the fastest first.

    Points with another sensor are left out; of equal points the first is kept.
    """
    # in order of speed, a point is on the front if it is more accurate than all before it
    able = [one for one in every if one.record.kind == kind and one.comparable]
    ordered = sorted(able, key=lambda one: (-one.speed, one.visible_error))
    best = math.inf
    kept = []
    for one in ordered:
        if one.visible_error < best:
            best = one.visible_error
            kept.append(one)
    return kept


def cases(records: Iterable[SweepRecord]) -> dict[tuple[str, str], list[SweepRecord]]:
    """(scene, camera) -> its records; points of different cases are not comparable."""
    found: dict[tuple[str, str], list[SweepRecord]] = {}
    for record in records:
        found.setdefault((record.scene, record.camera), []).append(record)
    return found
