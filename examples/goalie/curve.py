"""How many balls each tracker saves, over the whole range of their speeds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from evs.examples.goalie import TRACKERS
from evs.examples.goalie.shots import SAVES_M, Goal
from evs.examples.results import Results
from evs.tools.jobs import run_units

SLOWEST_M_S, FASTEST_M_S = 1.0, 64.0


@dataclass(frozen=True)
class Plan:
    """How thoroughly it is done."""

    trackers: tuple[str, ...] = tuple(TRACKERS)
    speeds: int = 19
    """from the slowest to the fastest, evenly by ratio"""
    shots: int = 100
    """at each speed; the same ones for every tracker"""


QUICK = Plan(speeds=4, shots=3)
"""A rehearsal."""


@dataclass(frozen=True)
class Unit:
    """All shots of one speed at one tracker."""

    tracker: str
    speed_m_s: float
    shots: int

    @property
    def name(self) -> str:
        """In the file of results."""
        return f"{self.speed_m_s:g}"


def speeds_of(plan: Plan) -> list[float]:
    """M/s, of three digits, so that they have names."""
    ends = math.log(SLOWEST_M_S), math.log(FASTEST_M_S)
    return [float(f"{value:.3g}") for value in np.exp(np.linspace(*ends, plan.speeds))]


def run_curve(plan: Plan, results: Results, jobs: int = 1) -> Iterator[Unit]:
    """Shoot what was not shot yet; gives each unit when it is done and kept."""
    every = [
        Unit(tracker, speed, plan.shots) for tracker in plan.trackers for speed in speeds_of(plan)
    ]
    todo = [unit for unit in every if not results.has(unit.tracker, unit.name)]
    for unit, saved in run_units(todo, shoot, jobs):
        results.put(unit.tracker, unit.name, saved)
        yield unit


def count_units(plan: Plan) -> int:
    """How many units there are in all."""
    return len(plan.trackers) * plan.speeds


def shoot(unit: Unit) -> int:
    """How many of the shots are saved; their seeds are 0, 1, ..."""
    goal = _goal(unit.tracker)
    return sum(goal.shoot(unit.speed_m_s, seed) <= SAVES_M for seed in range(unit.shots))


@lru_cache(maxsize=4)
def _goal(tracker: str) -> Goal:
    return Goal(tracker)


def plain_plan(plan: Plan) -> dict[str, Any]:
    """What a file of results is of."""
    told = asdict(plan)
    del told["trackers"]
    return {"loop": "goalie", **told, "speeds_m_s": speeds_of(plan)}


def half_speed(saved: dict[float, float]) -> float | None:
    """The speed above which fewer than half are saved, m/s, between two by ratio; None: never.

    In: speed -> share saved.
    """
    known = sorted(saved.items())
    for (slow, more), (fast, less) in itertools.pairwise(known):
        if more >= 0.5 > less:
            part = (more - 0.5) / (more - less)
            return float(slow * (fast / slow) ** part)
    return None
