"""Compare two event streams: matched and false events, stamps, counts, earth mover's distance."""

from evs.tools.metrics.compare import Comparison, compare
from evs.tools.metrics.counts import (
    CountRatio,
    RateMaps,
    compare_rate_maps,
    count_loss,
    count_map,
    count_ratio,
)
from evs.tools.metrics.emd import emd_map, mean_emd
from evs.tools.metrics.matching import Matching, TimingError, match_events, measure_timing
from evs.tools.metrics.spurious import Spurious, measure_spurious, static_pixels
from evs.tools.metrics.window import Window

__all__ = [
    "Comparison",
    "CountRatio",
    "Matching",
    "RateMaps",
    "Spurious",
    "TimingError",
    "Window",
    "compare",
    "compare_rate_maps",
    "count_loss",
    "count_map",
    "count_ratio",
    "emd_map",
    "match_events",
    "mean_emd",
    "measure_spurious",
    "measure_timing",
    "static_pixels",
]
