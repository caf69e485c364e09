"""Measure how many balls each tracker saves at each speed; the curve as a chart and a table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from evs.drivers.pictures.chart import Chart, Scale, Series, draw_charts
from evs.examples.common.results_file import ResultsFile
from evs.examples.goalie import TRACKERS
from evs.examples.goalie.environment import SAVES_M, GoalieExperiment
from evs.msgs.pictures import U8
from evs.tools.jobs import run_units

SLOWEST_M_S, FASTEST_M_S = 1.0, 64.0


@dataclass(frozen=True)
class CurvePlan:
    """Extent of the measurement."""

    trackers: tuple[str, ...] = tuple(TRACKERS)
    speeds: int = 19
    """from the slowest to the fastest, evenly by ratio"""
    shots: int = 100
    """at each speed; the same ones for every tracker"""


QUICK = CurvePlan(speeds=4, shots=3)
"""a quick trial run, whose numbers mean nothing"""


@dataclass(frozen=True)
class CurveUnit:
    """All shots of one speed at one tracker."""

    tracker: str
    speed_m_s: float
    shots: int

    @property
    def name(self) -> str:
        """Name in the file of results."""
        return f"{self.speed_m_s:g}"


def speeds_of(plan: CurvePlan) -> list[float]:
    """The speeds, m/s, rounded to three digits, which name them in the file of results."""
    ends = math.log(SLOWEST_M_S), math.log(FASTEST_M_S)
    return [float(f"{value:.3g}") for value in np.exp(np.linspace(*ends, plan.speeds))]


def run_curve(plan: CurvePlan, results: ResultsFile, jobs: int = 1) -> Iterator[CurveUnit]:
    """Run the units that have no result; yield each once its result is saved."""
    every = [
        CurveUnit(tracker, speed, plan.shots)
        for tracker in plan.trackers
        for speed in speeds_of(plan)
    ]
    todo = [unit for unit in every if not results.has(unit.tracker, unit.name)]
    for unit, saved in run_units(todo, shoot, jobs):
        results.put(unit.tracker, unit.name, saved)
        yield unit


def count_units(plan: CurvePlan) -> int:
    """How many units there are in all."""
    return len(plan.trackers) * plan.speeds


def shoot(unit: CurveUnit) -> int:
    """How many of the shots are saved; their seeds are 0, 1, ..."""
    experiment = _goal(unit.tracker)
    return sum(experiment.shoot(unit.speed_m_s, seed) <= SAVES_M for seed in range(unit.shots))


@lru_cache(maxsize=4)
def _goal(tracker: str) -> GoalieExperiment:
    return GoalieExperiment(tracker)


def plain_plan(plan: CurvePlan) -> dict[str, Any]:
    """The plan as plain data, for the file of results."""
    plain = asdict(plan)
    del plain["trackers"]
    return {"loop": "goalie", **plain, "speeds_m_s": speeds_of(plan)}


def half_speed(saved: dict[float, float]) -> float | None:
    """The speed above which fewer than half of the balls are saved, m/s; None: never.

    Args:
        saved: speed, m/s -> share saved; between two speeds the logarithm is interpolated.
    """
    known = sorted(saved.items())
    for (slow, more), (fast, less) in itertools.pairwise(known):
        if more >= 0.5 > less:
            part = (more - 0.5) / (more - less)
            return float(slow * (fast / slow) ** part)
    return None


COLOURS = {"events": (0, 114, 255), "200 FPS": (30, 30, 30), "60 FPS": (200, 120, 0)}

HEADINGS = ("tracker", "half are saved up to, m/s", "saved of all shots, %")


def shares(row: dict[str, int], shots: int) -> dict[float, float]:
    """Speed -> share saved, by speed."""
    return {speed: row[f"{speed:g}"] / shots for speed in sorted(map(float, row))}


def chart(rows: dict[str, dict[str, Any]], shots: int) -> U8:
    """Draw the share saved over speed, with standard errors, one line for each tracker."""
    series = []
    for tracker in [name for name in TRACKERS if name in rows]:
        known = shares(rows[tracker], shots)
        x, y = list(known), [100.0 * share for share in known.values()]
        error = [100.0 * math.sqrt(share * (1.0 - share) / shots) for share in known.values()]
        colour = COLOURS[tracker]
        series += [
            Series(x, y, colour, line=True),
            Series(x, y, colour, label=tracker, error=error),
        ]
    found = Chart(
        f"Balls saved, % of {shots} shots at each speed",
        Scale(SLOWEST_M_S, FASTEST_M_S, log=True, shown=(1, 2, 4, 8, 16, 32, 64)),
        Scale(0.0, 100.0),
        "speed of the ball, m/s",
        series,
    )
    return draw_charts([found], 1, (760, 420))


def table_rows(rows: dict[str, dict[str, Any]], shots: int) -> list[tuple[str, ...]]:
    """A row for each tracker."""
    rows_of_text = list[tuple[str, ...]]()
    for tracker in [name for name in TRACKERS if name in rows]:
        known = shares(rows[tracker], shots)
        half = half_speed(known)
        mean = 100.0 * sum(known.values()) / len(known)
        rows_of_text.append((tracker, "-" if half is None else f"{half:.3g}", f"{mean:.1f}"))
    return rows_of_text


def markdown(rows: dict[str, dict[str, Any]], shots: int, command: str) -> str:
    """The table and the command that made it, in Markdown."""
    lines = ["| " + " | ".join(HEADINGS) + " |", "|" + " --- |" * len(HEADINGS)]
    lines += ["| " + " | ".join(row) + " |" for row in table_rows(rows, shots)]
    return "\n".join([*lines, "", f"*`{command}`*", ""])
