"""Aggregate the measures of several clips into rows of a table: mean and standard deviation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from evs_lab.evaluation.measure import Measures

REFERENCE_PX = 346 * 260
"""pixels for which the cost of a tick is given"""


@dataclass(frozen=True)
class ResultCell:
    """One model on one light of one clip."""

    scene: str
    camera: str
    """its motion"""
    soft: bool
    """a lamp of the scene has a size"""
    light: str
    """path | direct | hybrid | converged"""
    spp: int
    seeds: str
    """fixed | fresh | cycle"""
    model: str
    measures: Measures
    antialiasing: str = "fixed"
    """fixed | adaptive: all samples at edges only"""


@dataclass(frozen=True)
class Aggregate:
    """A number of a row."""

    mean: float
    """of all clips together; NaN: not defined in any"""
    spread: float
    """standard deviation over the clips; NaN: fewer than two have the value"""


ClipMeasures = Sequence[Measures]


def _share(
    part: Callable[[Measures], float], total_of: Callable[[Measures], float]
) -> Callable[[ClipMeasures], float]:
    """Ratio of sums, so that a clip without motion has little weight."""

    def aggregated(clips: ClipMeasures) -> float:
        total = sum(total_of(m) for m in clips)
        return sum(part(m) for m in clips) / total if total else math.nan

    return aggregated


def _mean(of: Callable[[Measures], float]) -> Callable[[ClipMeasures], float]:
    def aggregated(clips: ClipMeasures) -> float:
        values = [value for m in clips if math.isfinite(value := of(m))]
        return float(np.mean(values)) if values else math.nan

    return aggregated


def _median(of: Callable[[Measures], float]) -> Callable[[ClipMeasures], float]:
    def aggregated(clips: ClipMeasures) -> float:
        values = [value for m in clips if math.isfinite(value := of(m))]
        return float(np.median(values)) if values else math.nan

    return aggregated


VALUES: dict[str, Callable[[ClipMeasures], float]] = {
    "emd": _mean(lambda m: m.emd),
    "count_on": _share(lambda m: m.on, lambda m: m.reference_on),
    "count_off": _share(lambda m: m.off, lambda m: m.reference_off),
    "count": _share(lambda m: m.on + m.off, lambda m: m.reference_on + m.reference_off),
    "static_hz": _share(lambda m: m.static_events, lambda m: m.static_px * m.seconds),
    "spurious_hz": _share(lambda m: m.on + m.off - m.pairs, lambda m: m.pixels * m.seconds),
    "recall": _share(lambda m: m.pairs, lambda m: m.reference_on + m.reference_off),
    "precision": _share(lambda m: m.pairs, lambda m: m.on + m.off),
    "patch_recall": _share(lambda m: m.patch_pairs, lambda m: m.patch_reference),
    "patch_precision": _share(lambda m: m.patch_pairs, lambda m: m.patch_events),
    "delay_us": _median(lambda m: m.delay_us),
    "timing_us": _median(lambda m: m.timing_us),
    "rmse_hz": _mean(lambda m: m.rmse_hz),
    "kl_nats": _mean(lambda m: m.kl_nats),
    "correlation": _mean(lambda m: m.correlation),
    "ms_per_tick": _share(lambda m: m.ms_per_tick * REFERENCE_PX, lambda m: m.pixels + m.patch_px),
}
"""name -> the value of several clips together: ratios of sums, means or medians"""


def aggregate(clips: ClipMeasures) -> dict[str, Aggregate]:
    """Every value of a row."""
    return {
        name: Aggregate(of(clips), _spread([of([m]) for m in clips])) for name, of in VALUES.items()
    }


def _spread(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.std(known, ddof=1)) if len(known) > 1 else math.nan


@dataclass(frozen=True)
class ResultRow:
    """One model on one kind of light, all scenes of one camera motion together."""

    camera: str
    light: str
    spp: int
    seeds: str
    antialiasing: str
    model: str
    scenes: int
    values: dict[str, Aggregate]


def aggregate_rows(cells: Sequence[ResultCell]) -> list[ResultRow]:
    """The rows, in the order of their first cells."""
    groups: dict[tuple[str, str, int, str, str, str], list[Measures]] = {}
    for cell in cells:
        key = (
            cell.camera, cell.light, cell.spp, cell.seeds, cell.antialiasing, cell.model
        )  # fmt: skip
        groups.setdefault(key, []).append(cell.measures)
    return [ResultRow(*key, len(clips), aggregate(clips)) for key, clips in groups.items()]
