"""The search of `evs tune` on random formulas: its answer was measured, and little is better."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs_lab.tuning.search import MOST, Search, TuningGoal
from evs_lab.tuning.space import Candidate, candidates

pytestmark = pytest.mark.property

EVERY = candidates()

STEP = 2.5
"""Samples come in steps of two: an answer may be one step, and a little, off the very best."""


@dataclass(frozen=True)
class Formula:
    """ms a tick: a sum of parts; error: powers of the samples over what each renderer cannot do."""

    direct_ms: float
    hybrid_ms: float
    cache_ms: float
    path_ms: float
    fixed_ms: float
    network_ms: float
    parallel: float
    direct_floor: float
    cached: float
    slope: float
    adaptive: float
    network: float
    ticks: float
    reference_error: float = 0.01

    def rtf(self, one: Candidate) -> float:
        ray_ms = {"direct": self.direct_ms, "hybrid": self.hybrid_ms, "path": self.path_ms}
        samples = one.spp if one.antialiasing == "fixed" else 1.0 + 0.2 * (one.spp - 1)
        trace_ms = ray_ms[one.renderer] * samples + self.cache_ms * (one.renderer == "hybrid")
        trace_ms /= 1.0 if one.threads == 1 else self.parallel
        model_ms = self.network_ms if one.model == "evsnet" else 0.0
        return one.tick_us / 1000 / (self.fixed_ms + model_ms + trace_ms)

    def error(self, one: Candidate) -> float:
        if one.renderer == "direct":
            off = self.direct_floor + 0.2 * one.spp**-0.5
        elif one.renderer == "hybrid":
            off = self.cached + 0.2 * one.spp**-0.5
        else:
            factor = {"plain": 1.0, "adaptive": self.adaptive, "evsnet": self.network}[one.model]
            off = 0.8 * factor * one.spp**-self.slope
        return min(1.0, off * (one.tick_us / 1000) ** self.ticks)

    def seconds(self, one: Candidate, rtf: float) -> float:
        return 0.0


formulas = st.builds(
    Formula,
    direct_ms=st.floats(0.3, 5.0),
    hybrid_ms=st.floats(0.3, 8.0),
    cache_ms=st.floats(0.1, 20.0),
    path_ms=st.floats(0.5, 20.0),
    fixed_ms=st.floats(0.05, 2.0),
    network_ms=st.floats(0.1, 10.0),
    parallel=st.floats(0.5, 2.0),
    direct_floor=st.floats(0.001, 0.7),
    cached=st.floats(0.001, 0.3),
    slope=st.floats(0.3, 0.8),
    adaptive=st.floats(0.6, 1.5),
    network=st.floats(0.5, 1.5),
    ticks=st.floats(0.0, 0.8),
)
goals = st.floats(-2.0, 0.5).map(lambda e: TuningGoal(rtf=10.0**e)) | st.floats(-1.5, -0.3).map(
    lambda e: TuningGoal(error=10.0**e)
)


@settings(deadline=None, max_examples=40)
@given(formulas, goals)
def test_the_answer_was_measured_and_nothing_known_is_better(
    scene: Formula, goal: TuningGoal
) -> None:
    found = Search(EVERY, goal, scene, lambda: math.inf).run()
    winner = found.winner
    assert winner.measured
    assert winner.rtf == scene.rtf(winner.candidate)
    assert winner.error == max(scene.error(winner.candidate), scene.reference_error)
    assert found.reached == goal.met(winner.rtf, winner.error)
    assert len(found.measured) <= MOST
    for one in found.measured:
        assert goal.rank(one.rtf, one.error) >= goal.rank(winner.rtf, winner.error)
    if found.better is not None:
        assert found.better.error < winner.error
    if found.faster is not None:
        assert found.faster.rtf > winner.rtf


@settings(deadline=None, max_examples=40, derandomize=True)
@given(formulas, goals)
def test_little_is_better_than_the_answer(scene: Formula, goal: TuningGoal) -> None:
    found = Search(EVERY, goal, scene, lambda: math.inf).run()
    values = [(scene.rtf(one), max(scene.error(one), scene.reference_error)) for one in EVERY]
    rtf, error = min(values, key=lambda both: goal.rank(*both))
    assert found.reached or not goal.met(0.9 * rtf, 1.1 * error)
    if found.reached and goal.rtf is not None:
        assert found.winner.error <= STEP * error
    if found.reached and goal.error is not None:
        assert found.winner.rtf >= rtf / STEP
