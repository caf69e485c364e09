"""The timing error of events that have a partner in the reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.msgs import Events
from evs.tools.metrics.matching import Matching


@dataclass(frozen=True)
class TimingError:
    """t_event - t_reference over all pairs, us; positive is late. NaN where there is no pair.

    No error beyond the matching's tolerance can be seen: read it beside recall. Pairs of two
    different pixels count too; match with tolerance_px = 0 to leave them out.
    """

    pairs: int
    median_us: float
    """the bias"""
    iqr_us: float
    """the spread: third less first quartile"""
    median_abs_us: float
    """median of the error without its sign"""


def measure_timing(events: Events, reference: Events, matching: Matching) -> TimingError:
    """The stamp errors of a matching's pairs; quartiles interpolate linearly.

    Args:
        events: (n,) EVENT_DTYPE, those that were matched
        reference: (m,) EVENT_DTYPE, likewise
        matching: of these two
    """
    error = events["t"][matching.event_index] - reference["t"][matching.reference_index]
    if not len(error):
        return TimingError(0, float("nan"), float("nan"), float("nan"))
    low, middle, high = np.quantile(error, [0.25, 0.5, 0.75])
    return TimingError(
        len(error), float(middle), float(high - low), float(np.median(np.abs(error)))
    )
