"""Search: measure a few candidates, predict all, measure the best, until the best is measured.

Predictions only choose what to measure; speed and error of the result are measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from evs.msgs import EvsError
from evs_lab.tuning.space import Candidate, calibration
from evs_lab.tuning.surrogate import COST, ERROR, Surrogate

MOST = 28
"""measurements of one search"""

SPEED_NOISE, ERROR_NOISE = 0.05, 0.05
"""standard deviation of a measurement, powers of two"""

LIKELY = 0.15
"""a configuration that beats the best with this probability is worth a measurement"""
GAIN = 1.1
"""by which factor it has to"""
CHECKS = 6
"""how many such measurements there may be after the best is known"""

LEAST_ERROR = 1e-4
"""replaces an error of 0, which has no logarithm"""


@dataclass(frozen=True)
class TuningGoal:
    """The goal of a search: one of the two."""

    rtf: float | None = None
    """real-time factor to reach, with the least error"""
    error: float | None = None
    """error to keep, at the highest speed"""

    def __post_init__(self) -> None:
        """Raises EvsError: no goal, two goals, or an impossible value."""
        if (self.rtf is None) == (self.error is None):
            raise EvsError("give one goal: --rtf 1.0 or --error 0.1")
        if self.rtf is not None and not 0.0 < self.rtf < math.inf:
            raise EvsError(f"--rtf is {self.rtf:g}: give a real-time factor above 0, as in 1.0")
        if self.error is not None and not 0.0 < self.error < math.inf:
            raise EvsError(f"--error is {self.error:g}: give an error above 0, as in 0.1")

    def met(self, rtf: float, error: float) -> bool:
        """Whether such a configuration reaches it."""
        return rtf >= self.rtf if self.rtf is not None else error <= (self.error or 0.0)

    def rank(self, rtf: float, error: float) -> tuple[float, ...]:
        """Rank, smaller is better: first what reaches the goal, then by the other quantity."""
        if self.met(rtf, error):
            return (0.0, error, -rtf) if self.rtf is not None else (0.0, -rtf, error)
        # nearer to the goal
        return (1.0, -rtf, error) if self.rtf is not None else (1.0, error, -rtf)

    def __str__(self) -> str:
        if self.rtf is not None:
            return f"real-time factor of at least {self.rtf:g}"
        return f"error of at most {self.error:g}"


class Measurer(Protocol):
    """Measures configurations on a scene."""

    reference_error: float
    """error of the reference, below which none can be measured"""

    def rtf(self, one: Candidate) -> float:
        """Real-time factor."""

    def error(self, one: Candidate) -> float:
        """Error of its events against those of converged light."""

    def seconds(self, one: Candidate, rtf: float) -> float:
        """Estimated time of both measurements at that real-time factor."""


@dataclass(frozen=True)
class CandidateResult:
    """Prediction and measurement of a configuration."""

    candidate: Candidate
    rtf: float
    """measured, else predicted"""
    error: float
    measured: bool
    rtf_factor: float = 1.0
    """by which factor a prediction may be off: one standard deviation"""
    error_factor: float = 1.0
    predicted_rtf: float = math.nan
    """before it was measured; NaN: it was measured to calibrate"""
    predicted_error: float = math.nan


@dataclass(frozen=True)
class SearchResult:
    """The result of a search."""

    goal: TuningGoal
    winner: CandidateResult
    reached: bool
    verified: bool
    """False: the budget ended before the best that was predicted could be measured"""
    better: CandidateResult | None
    """the fastest of those with less error"""
    faster: CandidateResult | None
    """the most accurate of those that are faster"""
    measured: list[CandidateResult]
    """in the order of measurement"""


Moved = Callable[[int, str], None]
"""(measurements done, what is being measured)"""


@dataclass
class Search:
    """One search over candidates."""

    candidates: Sequence[Candidate]
    goal: TuningGoal
    measurer: Measurer
    left_s: Callable[[], float]
    """seconds of the budget that are left"""
    moved: Moved = lambda _done, _what: None
    most: int = MOST
    known: dict[Candidate, CandidateResult] = field(default_factory=dict)
    errors: dict[Candidate, float] = field(default_factory=dict)
    """by `Candidate.light`: threads change no event"""

    def run(self) -> SearchResult:
        """Search.

        Raises:
            EvsError: not even one could be measured.
        """
        for one in calibration(self.candidates):
            if len(self.known) >= self.most or (self.known and self._too_long(one)):
                continue
            self._measure(one, None)
        verified, checks = True, 0
        while True:
            every = self._all()
            best = self._best(every)
            if best.measured:
                rival = self._rival(every, best) if checks < CHECKS else None
                if rival is None:
                    break
                best, checks = rival, checks + 1
            if len(self.known) >= self.most or self._too_long(best.candidate, best.rtf):
                verified = self._best(every).measured
                break
            self._measure(best.candidate, best)
        winner = self._best(self.known.values())
        return SearchResult(
            self.goal,
            winner,
            self.goal.met(winner.rtf, winner.error),
            verified,
            self._next(
                every, lambda one: one.error < winner.error, lambda one: (-one.rtf, one.error)
            ),
            self._next(every, lambda one: one.rtf > winner.rtf, lambda one: (one.error, -one.rtf)),
            list(self.known.values()),
        )

    def _best(self, some: Iterable[CandidateResult]) -> CandidateResult:
        # of equal ones the one that was measured
        return min(some, key=lambda one: (*self.goal.rank(one.rtf, one.error), not one.measured))

    def _rival(
        self, every: Sequence[CandidateResult], best: CandidateResult
    ) -> CandidateResult | None:
        """The unmeasured candidate that most likely beats the best by a tenth, if there is one."""
        if not self.goal.met(best.rtf, best.error):
            return None
        chances = []
        for one in every:
            if one.measured:
                continue
            fast = _chance(one.rtf / (self.goal.rtf or GAIN * best.rtf), one.rtf_factor)
            exact = _chance((self.goal.error or best.error / GAIN) / one.error, one.error_factor)
            chances.append((fast * exact, one))
        likeliest = max(chances, key=lambda pair: pair[0], default=(0.0, best))
        return likeliest[1] if likeliest[0] > LIKELY else None

    @staticmethod
    def _next(
        every: Iterable[CandidateResult],
        is_wanted: Callable[[CandidateResult], bool],
        rank: Callable[[CandidateResult], tuple[float, ...]],
    ) -> CandidateResult | None:
        return min((one for one in every if is_wanted(one)), key=rank, default=None)

    def _too_long(self, one: Candidate, rtf: float | None = None) -> bool:
        if rtf is None:
            rtf = float(self._surrogates()[0].at([one])[0][0]) ** -1
        return self.measurer.seconds(one, rtf) > self.left_s()

    def _measure(self, one: Candidate, predicted: CandidateResult | None) -> None:
        self.moved(len(self.known), str(one))
        if one.light not in self.errors:
            self.errors[one.light] = max(
                self.measurer.error(one), self.measurer.reference_error, LEAST_ERROR
            )
        rtf, error = self.measurer.rtf(one), self.errors[one.light]
        if not (math.isfinite(error) and math.isfinite(rtf) and rtf > 0.0):
            raise EvsError(
                "nothing happens in the scene, so there are no events to be right or wrong: let "
                "something move, or the camera (--motion pan)"
            )
        before = (math.nan, math.nan) if predicted is None else (predicted.rtf, predicted.error)
        self.known[one] = CandidateResult(one, rtf, error, True, 1.0, 1.0, *before)

    def _surrogates(self) -> tuple[Surrogate, Surrogate]:
        """Cost of a simulated second, and error, fitted to all that was measured."""
        cost, error = Surrogate(COST, SPEED_NOISE), Surrogate(ERROR, ERROR_NOISE)
        cost.fit(list(self.known), [1.0 / one.rtf for one in self.known.values()])
        error.fit(list(self.errors), list(self.errors.values()))
        return cost, error

    def _all(self) -> list[CandidateResult]:
        """Every candidate: measured, else predicted."""
        cost, error = self._surrogates()
        candidates = list(self.candidates)
        spent = zip(*cost.at(candidates), strict=True)
        off = zip(*error.at([one.light for one in candidates]), strict=True)
        found = []
        for one, (seconds, rtf_factor), (far, error_factor) in zip(
            candidates, spent, off, strict=True
        ):
            seen = max(float(far), self.measurer.reference_error, LEAST_ERROR)
            if one.light in self.errors:
                seen, error_factor = self.errors[one.light], 1.0
            prediction = CandidateResult(
                one, 1.0 / float(seconds), seen, False, rtf_factor, error_factor
            )
            found.append(self.known.get(one, prediction))
        return found


def _chance(ratio: float, factor: float) -> float:
    """Probability that a log-normal value with this median is at least 1."""
    if factor <= 1.0:
        return float(ratio >= 1.0)
    return 0.5 * (1.0 + math.erf(math.log(ratio) / math.log(factor) / math.sqrt(2.0)))
