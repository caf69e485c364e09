"""Search parameters: the best gains of a controller, and the hardest value that it survives."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from evs.msgs import EvsError

Point = dict[str, float]


@dataclass(frozen=True)
class Budget:
    """Extent of a search. Equal budgets try equally many points."""

    rounds: int = 5
    points: int = 10
    """tried in each round"""
    kept: int = 3
    """best points of a round, whose mean and spread the next round is drawn from"""

    @property
    def trials(self) -> int:
        """Points that are tried in all."""
        return self.rounds * self.points


def cross_entropy(
    score: Callable[[Point], float],
    box: Mapping[str, tuple[float, float]],
    begin: Point,
    budget: Budget,
    seed: int = 0,
) -> tuple[Point, float]:
    """Search a box with the cross-entropy method; the same seed tries the same points.

    Source: Rubinstein, The cross-entropy method for combinatorial and continuous optimization,
    1999.

    Args:
        score: rates a point; more is better.
        box: name -> least and largest value, both over 0; their logarithm is searched.
        begin: the first point tried and the middle of the first round.
        budget: how many points are tried.
        seed: of all random numbers.

    Returns:
        The best point that was tried, and its score.

    Raises:
        EvsError: the first point is outside the box, or the budget makes no sense.
    """
    for name, (low, high) in box.items():
        if not 0.0 < low < high or not low <= begin[name] <= high:
            raise EvsError(
                f"{name} is to lie in {low:g} ... {high:g} and to begin at {begin[name]:g}"
            )
    if not 1 < budget.kept <= budget.points or budget.rounds < 1:
        raise EvsError(f"a search keeps 2 points or more of each round: {budget}")
    random = np.random.default_rng(seed)
    least, most = (np.log([ends[k] for ends in box.values()]) for k in (0, 1))
    mean, spread = np.log([begin[name] for name in box]), (most - least) / 4.0
    best, highest = dict(begin), -math.inf
    for turn in range(budget.rounds):
        drawn = mean + spread * random.standard_normal((budget.points, len(box)))
        tried = np.clip(drawn, least, most)
        if turn == 0:
            tried[0] = mean
        points = [dict(zip(box, np.exp(row).tolist(), strict=True)) for row in tried]
        scores = np.array([score(point) for point in points])
        # stable: of equal ones the first
        order = np.argsort(-scores, kind="stable")[: budget.kept]
        if scores[order[0]] > highest:
            best, highest = points[order[0]], float(scores[order[0]])
        mean, spread = tried[order].mean(0), tried[order].std(0) + 0.02 * (most - least)
    return best, highest


def limit(
    survives: Callable[[float], bool], easy: float, hard: float, steps: int, whole: bool = False
) -> float | None:
    """Find the limit of a controller by bisection: of the ratio if both ends are over 0.

    Args:
        survives: whether a value is survived.
        easy: the easy end, which may be the larger or the smaller one.
        hard: the hard end.
        steps: bisections.
        whole: whether only whole numbers are tried.

    Returns:
        The hardest value that was tried and survived; `hard` if the limit lies beyond; None if
        `easy` is not survived.

    Raises:
        EvsError: the ends are equal, or there are no steps.
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
