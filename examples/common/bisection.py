"""Find the limit of a controller by bisection."""

from __future__ import annotations

import math
from collections.abc import Callable

from evs.msgs import EvsError


def limit(
    survives: Callable[[float], bool], easy: float, hard: float, steps: int, whole: bool = False
) -> float | None:
    """The hardest value that was tried and survived; None if even `easy` is not.

    Halved by ratio where both are over 0, else by difference. What survives `hard` is given back as
    `hard`: the limit lies beyond.

    Args:
        survives: whether a value is survived.
        easy: the ends, which may lie either way round.
        hard: the ends, which may lie either way round.
        steps: how often the rest is halved.
        whole: only whole numbers are tried.
    """
    if easy == hard or steps < 1:
        raise EvsError(f"nothing to halve between {easy:g} and {hard:g} in {steps} steps")
    if not survives(easy):
        return None
    if survives(hard):
        return hard
    good, bad = easy, hard
    for _ in range(steps):
        middle = math.sqrt(good * bad) if good > 0.0 and bad > 0.0 else 0.5 * (good + bad)
        if whole:
            middle = float(round(middle))
        if middle in (good, bad):
            break
        if survives(middle):
            good = middle
        else:
            bad = middle
    return good
