"""Compare two event streams: matched and false events, stamps, counts, earth mover's distance."""

from evs_lab.metrics.compare import Comparison, compare
from evs_lab.metrics.counts import (
    CountRatio,
    RateMaps,
    compare_rate_maps,
    count_loss,
    count_map,
    count_ratio,
)
from evs_lab.metrics.emd import emd_map, mean_emd
from evs_lab.metrics.matching import Matching, TimingError, match_events, measure_timing
from evs_lab.metrics.spurious import Spurious, measure_spurious, static_pixels
from evs_lab.metrics.window import Window

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
