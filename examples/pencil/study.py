"""Compare the trackers: tune each, then find its shortest stick, strongest push, longest delay.

All are tuned by the same search with the same budget on the same practice trials, then tested on
seeds that no search has seen. A value is survived if the stick stands with every seed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

from evs.examples.common.results_file import ResultsFile
from evs.examples.common.search import Budget, cross_entropy, limit
from evs.examples.pencil import TRACKERS
from evs.examples.pencil.balance import StickGains
from evs.examples.pencil.environment import PencilExperiment, PencilTrial
from evs.tools.jobs import run_units

BOX = {"fast": (1.2, 8.0), "slow": (0.1, 1.5), "observer_hz": (1.0, 100.0), "lag_ms": (0.1, 20.0)}
"""field of StickGains -> range of the search"""

BEGIN = {"fast": 2.5, "slow": 0.4, "observer_hz": 10.0, "lag_ms": 1.0}

PRACTICE = (
    PencilTrial(push_mns=5.0),
    PencilTrial(push_mns=9.0),
    PencilTrial(delay_ms=35.0),
    PencilTrial(delay_ms=60.0),
    PencilTrial(length_m=0.03),
    PencilTrial(length_m=0.018),
    PencilTrial(length_m=0.011),
)
"""trials by which gains are rated, from easy to beyond most trackers"""

BUDGET = Budget(rounds=4, points=8, kept=3)

PRACTICE_SEED, STAND_SEED = 1000, 2000
"""first seeds of practice and of standing; limits use 0, 1, ..."""

STEADY = 1e-3
"""cost of a millimetre of sway; a whole trial stood counts 1, so it only decides ties"""


@dataclass(frozen=True)
class StudyPlan:
    """Extent of the study."""

    trackers: tuple[str, ...] = tuple(TRACKERS)
    budget: Budget = BUDGET
    practice_s: float = 2.2
    """long enough for two pushes"""
    seeds: int = 4
    """for each value of a limit"""
    steps: int = 6
    """bisections of a limit"""
    limit_s: float = 3.0
    starts: int = 20
    """starts of the event tracker; the others have a quarter of them, at least one"""
    stand_s: float = 30.0
    stand_mns: float = 2.0
    """pushes, one a second, while it has to stand"""


QUICK = StudyPlan(
    budget=Budget(1, 2, 2), practice_s=0.4, seeds=1, steps=1, limit_s=0.6, starts=2, stand_s=1.0
)
"""a quick trial run, whose numbers mean nothing"""


@dataclass(frozen=True)
class StudyUnit:
    """One value to measure for one tracker."""

    tracker: str
    what: str
    """gains | shortest_m | strongest_mns | longest_ms | stood"""
    plan: StudyPlan
    gains: StickGains | None = None


AFTER = ("shortest_m", "strongest_mns", "longest_ms", "stood")
"""values that are measured with the tuned gains"""


def run_study(plan: StudyPlan, results: ResultsFile, jobs: int = 1) -> Iterator[StudyUnit]:
    """Measure the missing values; yield each unit once its value is saved."""
    todo = []
    for tracker in plan.trackers:
        if results.has(tracker, "gains"):
            todo += _rest(tracker, plan, results)
        else:
            todo.append(StudyUnit(tracker, "gains", plan))
    for unit, value in run_units(todo, find, jobs):
        results.put(unit.tracker, unit.what, value)
        if unit.what == "gains":
            todo += _rest(unit.tracker, plan, results)
        yield unit


def count_units(plan: StudyPlan) -> int:
    """How many units there are in all."""
    return len(plan.trackers) * (1 + len(AFTER))


def _rest(tracker: str, plan: StudyPlan, results: ResultsFile) -> list[StudyUnit]:
    gains = StickGains(**results.rows[tracker]["gains"]["found"])
    missing = [what for what in AFTER if not results.has(tracker, what)]
    return [StudyUnit(tracker, what, plan, gains) for what in missing]


def find(unit: StudyUnit) -> Any:
    """The value of a unit, plain data."""
    if unit.gains is None:
        return tune(unit.tracker, unit.plan)
    if unit.what == "stood":
        return stand(unit.tracker, unit.gains, unit.plan)
    easy = PencilTrial(seconds=unit.plan.limit_s)

    def survives(trial: PencilTrial) -> bool:
        return all(
            not _experiment(unit.tracker, trial).play(replace(trial, seed=seed), gains).fallen
            for seed in range(unit.plan.seeds)
        )

    gains, steps = unit.gains, unit.plan.steps
    if unit.what == "shortest_m":
        return limit(lambda length: survives(replace(easy, length_m=length)), 0.2, 0.005, steps)
    if unit.what == "strongest_mns":
        return limit(lambda push: survives(replace(easy, push_mns=push)), 1.0, 30.0, steps)
    return limit(lambda delay: survives(replace(easy, delay_ms=delay)), 0.0, 128.0, steps, True)


def tune(tracker: str, plan: StudyPlan) -> dict[str, Any]:
    """The gains of the best score, the score, and the number of trials."""

    def score(point: dict[str, float]) -> float:
        gains, total = StickGains(**point), 0.0
        for number, trial in enumerate(PRACTICE):
            trial = replace(trial, seconds=plan.practice_s, seed=PRACTICE_SEED + number)
            outcome = _experiment(tracker, trial).play(trial, gains)
            total += outcome.stood_s / plan.practice_s - STEADY * outcome.sway_mm
        return total

    found, best = cross_entropy(score, BOX, BEGIN, plan.budget)
    return {"found": found, "score": best, "tried": plan.budget.trials}


def stand(tracker: str, gains: StickGains, plan: StudyPlan) -> dict[str, Any]:
    """How many starts stand to the end, the shortest time of one, and the largest sway."""
    experiment = _experiment(tracker, PencilTrial())
    starts = plan.starts if tracker == "events" else max(1, plan.starts // 4)
    trials = [
        PencilTrial(push_mns=plan.stand_mns, seconds=plan.stand_s, seed=STAND_SEED + number)
        for number in range(starts)
    ]
    outcomes = [experiment.play(trial, gains) for trial in trials]
    return {
        "starts": starts,
        "stood": sum(not outcome.fallen for outcome in outcomes),
        "least_s": min(outcome.stood_s for outcome in outcomes),
        "sway_mm": max(outcome.sway_mm for outcome in outcomes),
    }


def _experiment(tracker: str, trial: PencilTrial) -> PencilExperiment:
    return _built(tracker, trial.length_m, trial.delay_ms)


@lru_cache(maxsize=16)
def _built(tracker: str, length_m: float, delay_ms: float) -> PencilExperiment:
    """Cached, since building a scene costs more than a reset."""
    return PencilExperiment(tracker, length_m, delay_ms)


def plain_plan(plan: StudyPlan) -> dict[str, Any]:
    """The plan as plain data, for the file of results; other trackers may be added later."""
    plain = asdict(plan)
    del plain["trackers"]
    practice = [asdict(replace(trial, seconds=plan.practice_s)) for trial in PRACTICE]
    return {"loop": "pencil", **plain, "box": BOX, "practice": practice}


HEADINGS = (
    "tracker",
    "shortest stick, mm",
    "strongest push, mN s",
    "longest delay, ms",
    "stood to the end",
    "gains (fast, slow, observer Hz, lag ms)",
)


def table_rows(rows: dict[str, dict[str, Any]], trackers: Sequence[str]) -> list[tuple[str, ...]]:
    """A row for each tracker; "-": not measured, "none": not even the easiest value."""
    return [(tracker, *_cells(rows.get(tracker, {}))) for tracker in trackers]


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    stood = row.get("stood")
    gains = row.get("gains", {}).get("found")
    return (
        _number(row, "shortest_m", 1e3),
        _number(row, "strongest_mns"),
        _number(row, "longest_ms"),
        "-" if stood is None else f"{stood['stood']} of {stood['starts']}",
        "-" if gains is None else ", ".join(f"{value:.3g}" for value in gains.values()),
    )


def _number(row: dict[str, Any], name: str, unit: float = 1.0) -> str:
    if name not in row:
        return "-"
    value = row[name]
    return "none" if value is None else f"{value * unit:.3g}"


def markdown(rows: dict[str, dict[str, Any]], trackers: Sequence[str], command: str) -> str:
    """The table and the command that made it, in Markdown."""
    lines = ["| " + " | ".join(HEADINGS) + " |", "|" + " --- |" * len(HEADINGS)]
    lines += ["| " + " | ".join(row) + " |" for row in table_rows(rows, trackers)]
    return "\n".join([*lines, "", f"*`{command}`*", ""])
