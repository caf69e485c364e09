"""The refractory period: no pixel has two events nearer than it.

Chance events come at any time after it, so the intervals just above it are evenly dense, and their
shortest is off by what a step of that density leaves. A soft edge, such as the spread of the
intervals inside a ramp, is no refractory period.
"""

from __future__ import annotations

import math

import numpy as np

from evs.tools.fit.estimate import Estimate, cannot
from evs.tools.fit.observed import Observed

KEY = "refractory_period_s"

FEWEST = 200
"""intervals"""

NEAR = 25
"""shortest intervals whose density is looked at, and as many beyond"""

PILE = 0.05
"""share of all intervals that may have the very shortest length"""

LEAST_US = 2
"""a shortest interval of this tells no period: stamps are whole us"""


def fit_refractory(seen: Observed) -> Estimate:
    """Fit the period from the shortest intervals of all pixels."""
    lengths = seen.intervals.length_us
    if len(lengths) < FEWEST:
        return cannot(KEY, seen.source, f"{len(lengths)} intervals between events of a pixel")
    first = np.partition(lengths, 2 * NEAR)[: 2 * NEAR + 1]
    first.sort()
    shortest, near, far = (float(first[k]) for k in (0, NEAR, 2 * NEAR))
    at_most = f"it is at most {shortest:g} us, the shortest interval"
    if shortest <= LEAST_US:
        return cannot(KEY, seen.source, at_most)
    # of evenly dense intervals, one of so many lies below the first
    step = (near - shortest) / NEAR
    error = math.hypot(step, 1.0 / math.sqrt(6.0))
    if error > 0.2 * shortest:
        return cannot(KEY, seen.source, at_most)
    if float(np.mean(lengths == lengths.min())) > PILE:
        return cannot(KEY, seen.source, f"{at_most}, at which the readout or the light piles them")
    # the first NEAR and the next are as long as each other, within chance, if the edge is hard
    one, other = near - shortest, far - near
    if abs(one - other) > 3.0 * (step * math.sqrt(2.0 * NEAR) + 1.0):
        return cannot(KEY, seen.source, f"{at_most}, and the edge is soft")
    return Estimate(KEY, 1e-6 * (shortest - step), 1e-6 * error, seen.source)
