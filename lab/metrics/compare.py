"""All metrics of one pair of streams in one call."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from evs.msgs import Events
from evs_lab.metrics.counts import (
    CountRatio,
    RateMaps,
    compare_rate_maps,
    count_loss,
    count_map,
    count_ratio,
)
from evs_lab.metrics.emd import mean_emd
from evs_lab.metrics.matching import TimingError, match_events, measure_timing
from evs_lab.metrics.spurious import Mask, Spurious, measure_spurious, static_pixels
from evs_lab.metrics.window import Window


@dataclass(frozen=True)
class Comparison:
    """How close events are to a reference, and under which definitions.

    NaN is a value that is not defined: a share of nothing, a median of nothing.
    """

    window: Window
    tolerance_us: int
    tolerance_px: int
    tick_us: int
    """tick of the earth mover's distance"""
    events: int
    """n, inside the window"""
    reference_events: int
    """m, inside the window"""
    pairs: int
    """one-to-one pairs within the tolerances, the largest number possible"""
    recall: float
    """pairs / m"""
    precision: float
    """pairs / n; 1 - false share"""
    spurious: Spurious
    timing: TimingError
    count_ratio: CountRatio
    count_loss: float
    """events per pixel, equation (10)"""
    rate_maps: RateMaps
    emd: float
    """events per pixel, equation (9)"""

    def to_dict(self) -> dict[str, Any]:
        """Nested dict of numbers for a report, strict JSON: None where a value is NaN."""
        plain: dict[str, Any] = _without_nan(asdict(self))
        return plain


def compare(
    events: Events,
    reference: Events,
    width: int,
    height: int,
    t_begin_us: int,
    t_end_us: int,
    *,
    tolerance_us: int = 3000,
    tolerance_px: int = 1,
    tick_us: int = 1000,
    static: Mask | None = None,
) -> Comparison:
    """Every metric of this folder over the stamps t_begin_us < t <= t_end_us.

    Events outside the window are left out of both streams before anything else, so an event whose
    partner lies just outside counts as unmatched: take windows much longer than tolerance_us.

    Args:
        events: (n,) EVENT_DTYPE, any order
        reference: (m,) EVENT_DTYPE, any order
        width: px
        height: px
        t_begin_us: us, itself not inside
        t_end_us: us, itself inside
        tolerance_us: of a pair's stamps, us
        tolerance_px: of a pair's x and y, px; also the margin of static pixels
        tick_us: of the earth mover's distance; the window is a multiple of it
        static: (height, width) bool, where no event should be; None: `static_pixels`, where the
            reference has no event

    Raises:
        EvsError: an argument makes no sense; one line says which
    """
    window = Window(width, height, t_begin_us, t_end_us)
    window.ticks(tick_us)
    events, reference = window.cut(events), window.cut(reference, "reference")
    matching = match_events(events, reference, tolerance_us, tolerance_px)
    if static is None:
        static = static_pixels(reference, window, tolerance_px)
    counts, reference_counts = count_map(events, window), count_map(reference, window)
    return Comparison(
        window=window,
        tolerance_us=int(tolerance_us),
        tolerance_px=int(tolerance_px),
        tick_us=int(tick_us),
        events=matching.events,
        reference_events=matching.references,
        pairs=matching.pairs,
        recall=matching.recall,
        precision=matching.precision,
        spurious=measure_spurious(events, matching, window, static),
        timing=measure_timing(events, reference, matching),
        count_ratio=count_ratio(events, reference),
        count_loss=count_loss(counts, reference_counts),
        rate_maps=compare_rate_maps(counts, reference_counts, window.duration_s),
        emd=mean_emd(events, reference, window, tick_us),
    )


def _without_nan(value: Any) -> Any:
    """The same nested dicts with None for every NaN."""
    if isinstance(value, dict):
        return {key: _without_nan(inner) for key, inner in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value
