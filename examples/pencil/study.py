"""Every tracker at its best, and how far each goes: shortest stick, strongest push, longest delay.

All are tuned by the same search with the same budget on the same practice, then tried on seeds that
no search has seen. A value counts as survived where every seed stands.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

from evs.examples.limits import limit
from evs.examples.pencil import TRACKERS
from evs.examples.pencil.arena import Arena, Trial
from evs.examples.pencil.balance import Gains
from evs.examples.results import Results
from evs.examples.search import Budget, cross_entropy
from evs.tools.jobs import run_units

BOX = {"fast": (1.2, 8.0), "slow": (0.1, 1.5), "observer_hz": (1.0, 100.0), "lag_ms": (0.1, 20.0)}
"""Field of Gains -> where it is searched."""

BEGIN = {"fast": 2.5, "slow": 0.4, "observer_hz": 10.0, "lag_ms": 1.0}

PRACTICE = (
    Trial(push_mns=5.0),
    Trial(push_mns=9.0),
    Trial(delay_ms=35.0),
    Trial(delay_ms=60.0),
    Trial(length_m=0.03),
    Trial(length_m=0.018),
    Trial(length_m=0.011),
)
"""What gains are judged by: from easy to beyond most."""

BUDGET = Budget(rounds=4, points=8, kept=3)

PRACTICE_SEED, STAND_SEED = 1000, 2000
"""First seeds of practice and of standing; limits are found on 0, 1, ..."""

STEADY = 1e-3
"""What a millimetre of sway costs beside a whole trial stood: only a tie is decided by it."""


@dataclass(frozen=True)
class Plan:
    """How thoroughly it is done."""

    trackers: tuple[str, ...] = tuple(TRACKERS)
    budget: Budget = BUDGET
    practice_s: float = 2.2
    """long enough for two pushes"""
    seeds: int = 4
    """of each value of a limit"""
    steps: int = 6
    """how often a limit's rest is halved"""
    limit_s: float = 3.0
    starts: int = 20
    """of the event tracker; the others stand from a quarter of them, at least one"""
    stand_s: float = 30.0
    stand_mns: float = 2.0
    """pushes, one a second, while it has to stand"""


QUICK = Plan(
    budget=Budget(1, 2, 2), practice_s=0.4, seeds=1, steps=1, limit_s=0.6, starts=2, stand_s=1.0
)
"""Minutes become seconds; the numbers mean nothing."""


@dataclass(frozen=True)
class Unit:
    """One thing to find out about one tracker."""

    tracker: str
    what: str
    """gains | shortest_m | strongest_mns | longest_ms | stood"""
    plan: Plan
    gains: Gains | None = None


AFTER = ("shortest_m", "strongest_mns", "longest_ms", "stood")
"""What is found out with the gains that were tuned."""


def run_study(plan: Plan, results: Results, jobs: int = 1) -> Iterator[Unit]:
    """Find out what is not known yet; gives each unit when it is done and kept."""
    todo = []
    for tracker in plan.trackers:
        if results.has(tracker, "gains"):
            todo += _rest(tracker, plan, results)
        else:
            todo.append(Unit(tracker, "gains", plan))
    for unit, value in run_units(todo, find, jobs):
        results.put(unit.tracker, unit.what, value)
        if unit.what == "gains":
            todo += _rest(unit.tracker, plan, results)
        yield unit


def count_units(plan: Plan) -> int:
    """How many units there are in all."""
    return len(plan.trackers) * (1 + len(AFTER))


def _rest(tracker: str, plan: Plan, results: Results) -> list[Unit]:
    gains = Gains(**results.rows[tracker]["gains"]["found"])
    missing = [what for what in AFTER if not results.has(tracker, what)]
    return [Unit(tracker, what, plan, gains) for what in missing]


def find(unit: Unit) -> Any:
    """The value of a unit, plain data."""
    if unit.gains is None:
        return tune(unit.tracker, unit.plan)
    if unit.what == "stood":
        return stand(unit.tracker, unit.gains, unit.plan)
    easy = Trial(seconds=unit.plan.limit_s)

    def survives(trial: Trial) -> bool:
        return all(
            not _arena(unit.tracker, trial).play(replace(trial, seed=seed), gains).fallen
            for seed in range(unit.plan.seeds)
        )

    gains, steps = unit.gains, unit.plan.steps
    if unit.what == "shortest_m":
        return limit(lambda length: survives(replace(easy, length_m=length)), 0.2, 0.005, steps)
    if unit.what == "strongest_mns":
        return limit(lambda push: survives(replace(easy, push_mns=push)), 1.0, 30.0, steps)
    return limit(lambda delay: survives(replace(easy, delay_ms=delay)), 0.0, 128.0, steps, True)


def tune(tracker: str, plan: Plan) -> dict[str, Any]:
    """The gains of the best score, the score and how many were tried."""

    def score(point: dict[str, float]) -> float:
        gains, total = Gains(**point), 0.0
        for number, trial in enumerate(PRACTICE):
            trial = replace(trial, seconds=plan.practice_s, seed=PRACTICE_SEED + number)
            outcome = _arena(tracker, trial).play(trial, gains)
            total += outcome.stood_s / plan.practice_s - STEADY * outcome.sway_mm
        return total

    found, best = cross_entropy(score, BOX, BEGIN, plan.budget)
    return {"found": found, "score": best, "tried": plan.budget.trials}


def stand(tracker: str, gains: Gains, plan: Plan) -> dict[str, Any]:
    """How many of the starts stand to the end, and the shortest time that one did."""
    arena = _arena(tracker, Trial())
    starts = plan.starts if tracker == "events" else max(1, plan.starts // 4)
    trials = [
        Trial(push_mns=plan.stand_mns, seconds=plan.stand_s, seed=STAND_SEED + number)
        for number in range(starts)
    ]
    outcomes = [arena.play(trial, gains) for trial in trials]
    return {
        "starts": starts,
        "stood": sum(not outcome.fallen for outcome in outcomes),
        "least_s": min(outcome.stood_s for outcome in outcomes),
        "sway_mm": max(outcome.sway_mm for outcome in outcomes),
    }


def _arena(tracker: str, trial: Trial) -> Arena:
    return _built(tracker, trial.length_m, trial.delay_ms)


@lru_cache(maxsize=16)
def _built(tracker: str, length_m: float, delay_ms: float) -> Arena:
    """Building a scene costs more than a reset."""
    return Arena(tracker, length_m, delay_ms)


def plain_plan(plan: Plan) -> dict[str, Any]:
    """What a file of results is of; other trackers may join it later."""
    told = asdict(plan)
    del told["trackers"]
    practice = [asdict(replace(trial, seconds=plan.practice_s)) for trial in PRACTICE]
    return {"loop": "pencil", **told, "box": BOX, "practice": practice}
