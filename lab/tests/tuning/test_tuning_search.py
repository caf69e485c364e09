"""The search of `evs tune`, on scenes whose costs and errors are known formulas."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from evs.drivers.run.config import PipelineConfig
from evs.emulator.config import ModelConfig
from evs.emulator.config.decoding import override, to_text
from evs.msgs import EvsError
from evs_lab.sweep.points import check
from evs_lab.tuning.search import MOST, Search, SearchResult, TuningGoal
from evs_lab.tuning.space import Candidate, calibration, candidates
from evs_lab.tuning.surrogate import COST, EFFECTS, ERROR, Surrogate, effects_of


@dataclass
class Formula:
    """ms a tick are a sum of what each part costs, errors fall by powers of the samples."""

    parallel: float = 1.8
    """how much faster two threads trace than one"""
    floor: float = 0.02
    """what `direct` can never find: soft light"""
    cached: float = 0.05
    """what is wrong with the cached light of `hybrid`"""
    wrong: Callable[[Candidate], tuple[float, float]] = lambda _: (1.0, 1.0)
    """factors on cost and error that no model would guess"""
    reference_error: float = 0.008
    timed: list[Candidate] = field(default_factory=list)
    judged: list[Candidate] = field(default_factory=list)

    def true_rtf(self, one: Candidate) -> float:
        ray_ms = {"direct": 1.1, "hybrid": 1.5, "path": 2.3}[one.renderer]
        samples = float(one.spp)
        if one.antialiasing == "adaptive":
            samples = 0.35 * one.spp if one.renderer == "path" else 1 + 0.3 * (one.spp - 1)
        if one.renderer == "hybrid":
            samples += 1.0
        trace_ms = ray_ms * samples * (1.0 if one.threads == 1 else 1 / self.parallel)
        model_ms = {"plain": 0.3, "adaptive": 0.4, "evsnet": 2.5}[one.model]
        tick_ms = 0.2 + model_ms + trace_ms
        return one.tick_us / 1000 / (tick_ms * self.wrong(one)[0])

    def true_error(self, one: Candidate) -> float:
        if one.renderer == "direct":
            off = self.floor + 0.3 * one.spp**-0.5
        elif one.renderer == "hybrid":
            off = self.cached + 0.15 * one.spp**-0.5
        elif one.model == "plain":
            # samples at edges are worth half as many everywhere
            worth = 0.5 if one.antialiasing == "adaptive" else 1.0
            off = 0.9 * (worth * one.spp) ** -0.7
        elif one.model == "adaptive":
            off = 0.5 * one.spp**-0.45
        else:
            off = 0.45 * one.spp**-0.35
        ticks = one.tick_us / 1000
        return max(
            self.reference_error, min(1.0, off * (0.8 + 0.2 * ticks**1.3)) * self.wrong(one)[1]
        )

    def rtf(self, one: Candidate) -> float:
        self.timed.append(one)
        return self.true_rtf(one)

    def error(self, one: Candidate) -> float:
        self.judged.append(one)
        return self.true_error(one)

    def seconds(self, one: Candidate, rtf: float) -> float:
        return 0.05 / rtf + 0.001 * one.spp


def tuned(
    goal: TuningGoal, scene: Formula, given: list[Candidate] | None = None, budget: float = 1e9
) -> SearchResult:
    def left() -> float:
        return budget - sum(scene.seconds(c, scene.true_rtf(c)) for c in scene.timed)

    return Search(given or candidates(), goal, scene, left).run()


def best(goal: TuningGoal, scene: Formula) -> tuple[float, float]:
    """(real-time factor, error) of the best there is, by looking at all of them."""
    every = [(scene.true_rtf(c), scene.true_error(c)) for c in candidates()]
    return min(every, key=lambda values: goal.rank(*values))


GOALS = [TuningGoal(rtf=r) for r in (3.0, 1.0, 0.3, 0.1, 0.02)]
GOALS += [TuningGoal(error=e) for e in (0.3, 0.15, 0.05, 0.02)]


@pytest.mark.parametrize("goal", GOALS, ids=str)
@pytest.mark.parametrize("floor", [0.002, 0.1])
def test_the_optimum_of_a_formula_is_found(goal: TuningGoal, floor: float) -> None:
    scene = Formula(floor=floor)
    found = tuned(goal, scene)
    assert found.reached
    assert found.verified
    assert found.winner.measured
    assert (found.winner.rtf, found.winner.error) == (
        scene.true_rtf(found.winner.candidate),
        scene.true_error(found.winner.candidate),
    )
    rtf, error = best(goal, scene)
    # within a quarter of the very best, of all that could be chosen
    if goal.rtf is not None:
        assert found.winner.error <= 1.25 * error
    else:
        assert found.winner.rtf >= rtf / 1.25
    assert len(scene.timed) <= MOST
    assert len(scene.timed) < len(candidates()) / 8


def test_what_is_measured_is_measured_once_and_threads_change_no_error() -> None:
    scene = Formula()
    tuned(TuningGoal(rtf=0.3), scene)
    assert len(set(scene.timed)) == len(scene.timed)
    assert len(set(scene.judged)) == len(scene.judged)
    assert {c.threads for c in scene.timed} == {0, 1}
    lights = {c.light for c in scene.timed}
    assert {c.light for c in scene.judged} == lights
    assert len(scene.judged) == len(lights)


def test_a_single_thread_wins_where_threads_only_get_in_each_others_way() -> None:
    scene = Formula(parallel=0.5)
    assert tuned(TuningGoal(rtf=0.3), scene).winner.candidate.threads == 1


@pytest.mark.parametrize(
    "goal", [TuningGoal(rtf=1.0), TuningGoal(rtf=0.05), TuningGoal(error=0.06)], ids=str
)
def test_a_wrong_prediction_is_corrected_by_measuring(goal: TuningGoal) -> None:
    """What promises to be best is four times as dear and errs twice as much as all that is near."""
    promised = tuned(goal, Formula()).winner.candidate

    def trap(one: Candidate) -> tuple[float, float]:
        return (4.0, 2.0) if one.light == promised.light else (1.0, 1.0)

    scene = Formula(wrong=trap)
    found = tuned(goal, scene)
    fell = next(one for one in found.measured if one.candidate == promised)
    assert fell.predicted_rtf > 2.0 * fell.rtf
    assert found.winner.candidate != promised
    assert found.reached
    assert found.verified
    rtf, error = best(goal, scene)
    assert found.winner.error <= 1.25 * error if goal.rtf else found.winner.rtf >= rtf / 1.25


def test_what_cannot_be_reached_ends_in_the_best_there_is() -> None:
    scene = Formula()
    fast = tuned(TuningGoal(rtf=1e4), scene)
    assert not fast.reached
    assert fast.winner.rtf == pytest.approx(best(TuningGoal(rtf=1e4), scene)[0], rel=0.1)
    exact = tuned(TuningGoal(error=1e-3), Formula())
    assert not exact.reached
    # the reference cannot tell anything below its own error
    assert exact.winner.error == 0.008


def test_a_budget_bounds_the_measuring() -> None:
    scene = Formula()
    found = tuned(TuningGoal(error=0.01), scene, budget=2.0)
    spent = sum(scene.seconds(c, scene.true_rtf(c)) for c in scene.timed)
    assert spent < 2.0 * 1.5
    assert not found.verified
    assert found.winner.measured
    # nothing at all to spend: one is measured all the same
    assert len(tuned(TuningGoal(error=0.01), Formula(), budget=0.0).measured) == 1


def test_what_the_next_steps_would_have_cost() -> None:
    scene = Formula()
    found = tuned(TuningGoal(rtf=0.3), scene)
    assert found.better is not None
    assert found.faster is not None
    assert found.better.error < found.winner.error
    assert found.better.rtf < 0.3
    assert found.faster.rtf > found.winner.rtf
    assert found.faster.error >= found.winner.error


def test_a_scene_without_events_is_told() -> None:
    @dataclass
    class Dead(Formula):
        def error(self, one: Candidate) -> float:
            return math.nan

    with pytest.raises(EvsError, match="nothing happens in the scene"):
        tuned(TuningGoal(rtf=1.0), Dead())


def test_goals_that_make_no_sense() -> None:
    for wanted in ({}, {"rtf": 1.0, "error": 0.1}):
        with pytest.raises(EvsError, match=r"give one goal: --rtf 1\.0 or --error 0\.1"):
            TuningGoal(**wanted)
    for wanted in ({"rtf": 0.0}, {"rtf": math.inf}, {"rtf": math.nan}):
        with pytest.raises(EvsError, match="--rtf is "):
            TuningGoal(**wanted)
    with pytest.raises(EvsError, match="--error is -1: give an error above 0"):
        TuningGoal(error=-1.0)


def test_candidates_and_their_calibration() -> None:
    every = candidates()
    assert len(set(every)) == len(every) > 150
    assert {c.model for c in every} == {"plain", "adaptive", "evsnet"}
    assert {c.tick_us for c in every if c.model == "evsnet"} == {1000}
    few = calibration(every)
    assert set(few) <= set(every)
    assert len(few) == len(set(few)) <= 16
    assert {c.family for c in few} == {c.family for c in every}
    assert max(c.spp for c in few) <= 16
    assert [c.renderer for c in few] == sorted(c.renderer for c in few)
    assert few[0].renderer == "direct"


def test_pinned_keys_are_kept() -> None:
    fresh = candidates({"render.seeds": "fresh", "model.name": "evsnet"})
    assert {(c.renderer, c.seeds, c.model) for c in fresh} == {("path", "fresh", "evsnet")}
    one = candidates({"render.renderer": "path", "render.spp": 24, "scene.tick_us": 250,
                      "render.antialiasing": "fixed", "threads": 3,
                      "model.name": "plain"})  # fmt: skip
    assert [(c.spp, c.tick_us, c.threads) for c in one] == [(24, 250, 3)]
    assert calibration(one) == one
    hybrid = candidates({"render.renderer": "hybrid", "threads": 0, "scene.tick_us": 1000})
    assert [(c.spp, c.antialiasing) for c in hybrid] == [
        *((1, "fixed"), (4, "adaptive"), (4, "fixed"), (16, "adaptive"), (16, "fixed")),
    ]
    assert {(c.seeds, c.model) for c in hybrid} == {("fixed", "plain")}
    # keys that are no matter of tuning pin nothing
    assert candidates({"sensor.preset": "ideal"}) == candidates()
    with pytest.raises(
        EvsError, match=r"render.renderer=raster is not tuned; give direct or hybrid or path"
    ):
        candidates({"render.renderer": "raster"})


def test_every_candidate_is_a_pipeline_that_runs() -> None:
    """Even in place of one that takes 16 ticks at once."""
    before = PipelineConfig(model=ModelConfig(name="evsnet", chunk=16))
    for one in candidates():
        texts = ((key, to_text(value)) for key, value in one.settings.items())
        config = override(before, texts)
        check(config)
        assert config.render.samples == one.spp
        assert (config.model.name, config.threads) == (one.model, one.threads)
        assert config.model.chunk == (8 if one.model == "evsnet" else 1)


def test_many_ticks_at_once_are_for_the_network_alone() -> None:
    assert {c.model for c in candidates({"model.chunk": 16})} == {"evsnet"}
    assert candidates({"model.chunk": 1}) == candidates()


def test_a_surface_meets_what_was_measured_and_says_how_sure_it_is() -> None:
    assert tuple(COST) == tuple(ERROR) == EFFECTS
    assert all(len(effects_of(one)) == len(EFFECTS) for one in candidates())
    scene = Formula()
    known = calibration(candidates())
    surface = Surrogate(COST, 0.01)
    surface.fit(known, [1.0 / scene.true_rtf(one) for one in known])
    values, factors = surface.at(known)
    for one, value, factor in zip(known, values, factors, strict=True):
        assert 1.0 / value == pytest.approx(scene.true_rtf(one), rel=0.02)
        assert factor < 1.02
    far = Candidate("path", 1024, "fixed", "fixed", "plain")
    assert surface.at([far])[1][0] > 1.3
    # eight doublings beyond the last that was measured, and still of the right size
    assert 1.0 / surface.at([far])[0][0] == pytest.approx(scene.true_rtf(far), rel=0.6)


def test_before_anything_is_measured_a_surface_knows_next_to_nothing() -> None:
    surface = Surrogate(ERROR, 0.05)
    _, factors = surface.at(candidates()[:3])
    assert factors.min() > 8.0
