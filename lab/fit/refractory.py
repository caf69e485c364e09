"""The refractory period: no pixel has two events nearer than it.

Chance events come at any time after it, so the intervals just above it are evenly dense, and their
shortest is off by what a step of that density leaves. A soft edge, such as the spread of the
intervals inside a ramp, is no refractory period.
"""

from __future__ import annotations

import math

import numpy as np

from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.observed import Observed

KEY = "refractory_period_s"

FEWEST = 200
"""intervals"""

NEAR = 40
"""pixels with the shortest intervals, whose density is compared with that of as many beyond"""

UNEVEN = 0.7
"""logarithm of a ratio of densities that chance does not reach: 3.1 times sqrt(2 / NEAR)"""

EDGE_US = 6.0
"""an edge that is not wider is hard: stamps are whole us"""

PILE = 0.05
"""share of all intervals that may have the very shortest length"""

LEAST_US = 2
"""a shortest interval of this tells no period: stamps are whole us"""


def fit_refractory(seen: Observed, *, still: bool = False) -> Estimate:
    """Fit the period from the shortest intervals of all pixels.

    Args:
        seen: Any recording; noise at constant light is best.
        still: The light is constant. Then only ON and OFF in turn is noise for sure: the leak of
            hot pixels is regular and ON.
    """
    every = seen.intervals
    chosen = (every.before_on != every.after_on) | (not still)
    lengths, pixel = every.length_us[chosen], every.pixel[chosen]
    if len(lengths) < FEWEST:
        return cannot(KEY, seen.source, f"{len(lengths)} intervals between events of a pixel")
    # one of each pixel: a pixel may repeat its interval in each period of the light
    own = np.full(seen.pixels, np.iinfo(np.int64).max)
    np.minimum.at(own, pixel, lengths)
    first = np.sort(own)[: 2 * NEAR + 1]
    if len(first) <= 2 * NEAR or int(first[-1]) == np.iinfo(np.int64).max:
        return cannot(KEY, seen.source, f"fewer than {2 * NEAR + 1} pixels have intervals")
    shortest, near, far = (float(first[k]) for k in (0, NEAR, 2 * NEAR))
    at_most = f"it is at most {shortest:g} us, the shortest interval"
    if shortest <= LEAST_US:
        return cannot(KEY, seen.source, at_most)
    # of evenly dense intervals, one of so many lies below the first
    step = (near - shortest) / NEAR
    error = math.hypot(step, 1.0 / math.sqrt(6.0))
    if error > 0.1 * shortest:
        return cannot(KEY, seen.source, at_most)
    if float(np.mean(lengths == lengths.min())) > PILE:
        return cannot(KEY, seen.source, f"{at_most}, at which the readout or the light piles them")
    # the first NEAR and the next are as long as each other, within chance, if the edge is hard
    one, other = near - shortest, far - near
    # intervals become denser with their length where the edge is soft
    if one + other > EDGE_US and math.log((one + 0.5) / (other + 0.5)) > UNEVEN:
        return cannot(KEY, seen.source, f"{at_most}, and the edge is soft")
    return Estimate(KEY, 1e-6 * (shortest - step), 1e-6 * error, seen.source)
