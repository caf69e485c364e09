"""The median of a few repeats, and its 95 % confidence interval."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evs.tools.sweep.record import ConfidenceInterval

COVERAGE = 0.95

STUDENT = {2: 12.706, 3: 4.303, 4: 3.182, 5: 2.776}
"""repeats -> the 97.5 % quantile of Student's t with one degree of freedom less"""

_MOST_LOG = 100.0
"""of an interval's half: what is wider says nothing, and must not overflow"""


def confidence_interval(values: Sequence[float]) -> ConfidenceInterval:
    """The median and what it lies in with 95 % confidence.

    From six repeats on by order statistics, which need no law of the noise: the median lies between
    the k-th smallest and the k-th largest of n with probability 1 - 2 P(Binomial(n, 1/2) < k), and
    k is the largest that keeps 95 %. Of fewer no two repeats reach that: there Student's t of their
    logarithms, around the median's, since times differ by factors; of values that have none, as a
    stage that took no time, it is of the values, not below zero. Of one it is not known: NaN.
    """
    found = np.sort(np.asarray(values, np.float64))
    n, median = len(found), float(np.median(found))
    if n == 1:
        return ConfidenceInterval(median, math.nan, math.nan, 1)
    if n in STUDENT:
        share = STUDENT[n] / math.sqrt(n)
        if found[0] > 0.0:
            factor = math.exp(min(share * float(np.std(np.log(found), ddof=1)), _MOST_LOG))
            return ConfidenceInterval(median, median / factor, median * factor, n)
        half = share * float(np.std(found, ddof=1))
        return ConfidenceInterval(median, max(0.0, median - half), median + half, n)
    k = order(n)
    return ConfidenceInterval(median, float(found[k - 1]), float(found[n - k]), n)


def order(n: int) -> int:
    """The largest k for which the k-th smallest and the k-th largest of n keep 95 %; from 6 on."""
    below = 1.0
    k = 0
    while 1.0 - 2.0 * below / 2.0**n >= COVERAGE:
        k += 1
        below += math.comb(n, k)
    return k
