"""Claims of a Run: what holds, what does not, and what the messages say. Traces made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evs.msgs import EvsError
from evs.tools.testing import Run, Trace


def trace(values: Any, seed: int = 0, done: str = "", took_us: Any = 50.0, **more: Any) -> Trace:
    """An episode of decisions of 1 ms whose sensor "angle" says these values."""
    values = np.asarray(values, np.float64).reshape(len(values), -1)
    n = len(values) - 1
    return Trace(
        seed=seed,
        t_us=np.arange(n + 1) * 1000,
        sensors={"angle": values, **more},
        ctrl=np.zeros((n, 1)),
        compute_s=np.broadcast_to(np.asarray(took_us, np.float64) * 1e-6, n),
        events=7,
        done=done,
        start=b"",
    )


def run(*traces: Trace, seconds: float = 0.01) -> Run:
    return Run(traces, seconds, keep=lambda one: (f"kept seed {one.seed}",))


def fails(claim: Any, *says: str) -> None:
    with pytest.raises(AssertionError) as caught:
        claim()
    for words in says:
        assert words in str(caught.value)


STEADY = [0.5, 0.2, 0.1] + [0.0] * 8


def test_what_settles_settles() -> None:
    both = run(trace(STEADY), trace([-value for value in STEADY], seed=1))
    both.settles("angle", within=0.05, after_s=0.003)
    # the edges of time and of the range belong to it
    both.settles("angle", within=0.1, after_s=0.002)
    both.settles("angle", within=0.5)
    run(trace([1.0] * 11)).settles("angle", within=0.0, target=1.0)


def test_what_does_not_settle_is_told_by_its_worst_seed() -> None:
    bad = STEADY[:8] + [0.0, 0.3, 0.0]
    worse = STEADY[:6] + [-0.1, -0.4, 0.0, 0.0, 0.0]
    several = run(trace(STEADY), trace(bad, seed=4), trace(worse, seed=9))
    fails(
        lambda: several.settles("angle", within=0.05, after_s=0.003),
        "angle does not settle: seed 9 is at -0.4 at t = 0.007 s, 0.35 outside -0.05 ... 0.05",
        "first outside at t = 0.006 s, 2 of 8 moments",
        "2 of 3 seeds fail: 4, 9",
        "kept seed 9",
    )
    fails(lambda: several.settles("angle", within=0.1, after_s=0.001), "at t = 0.001 s")


def test_ranges_hold_at_every_moment() -> None:
    one = run(trace(STEADY))
    one.never_leaves("angle", 0.0, 0.5)
    fails(
        lambda: one.never_leaves("angle", 0.0, 0.4),
        "angle leaves its range: seed 0 is at 0.5 at t = 0.000 s, 0.1 outside 0 ... 0.4",
    )
    fails(lambda: one.never_leaves("angle", 0.05, 1.0), "8 of 11 moments")


def test_a_nan_is_outside_of_everything() -> None:
    one = run(trace([0.0, np.nan, 0.0]), seconds=0.002)
    fails(lambda: one.never_leaves("angle", -1, 1), "seed 0 is at nan at t = 0.001 s")


def test_a_nan_before_its_time_is_no_matter() -> None:
    before = [0.0, np.nan, np.inf, 0.0, 0.1]
    run(trace(before), seconds=0.004).settles("angle", within=0.2, after_s=0.003)
    fails(
        lambda: run(trace(before), seconds=0.004).settles("angle", within=0.05, after_s=0.003),
        "is at 0.1 at t = 0.004 s, 0.05 outside",
    )


def test_each_number_of_a_sensor_has_to_hold() -> None:
    one = run(trace([[0.0, 0.0], [0.0, 2.0], [0.0, 0.0]]), seconds=0.002)
    one.never_leaves("angle", 0, 2)
    fails(lambda: one.never_leaves("angle", 0, 1), "seed 0 is at 0, 2 at t = 0.001 s, 1 outside")


def test_an_episode_that_ended_early_proves_nothing() -> None:
    early = run(trace(STEADY), trace(STEADY[:5], seed=3, done="angle left -1 ... 1"))
    says = "seed 3 ends at t = 0.004 s of 0.01 s: angle left -1 ... 1"
    fails(early.never_ends, "an episode ends before its time", says, "1 of 2 seeds fail: 3")
    fails(lambda: early.never_leaves("angle", -1, 1), says)
    fails(lambda: early.settles("angle", within=1), says)
    fails(lambda: early.settles("angle", within=1, after_s=0.008), says)
    # it is told, too, where the range was left before
    fails(lambda: early.never_leaves("angle", 0, 0.4), "0.1 outside")
    run(trace(STEADY)).never_ends()


def test_the_budget_is_of_all_decisions_together() -> None:
    took = np.full(100, 50.0)
    took[[3, 70]] = 900.0
    both = run(trace(np.zeros(101), took_us=took), trace(np.zeros(101), seed=1), seconds=0.1)
    both.latency_budget(median_us=50.001)
    # 2 of 200 are slow: the 99th percentile is the 198th
    both.latency_budget(median_us=51, p99_us=51)
    took[71] = 1000.0
    both = run(trace(np.zeros(101), took_us=took), trace(np.zeros(101), seed=1), seconds=0.1)
    fails(
        lambda: both.latency_budget(median_us=49, p99_us=899),
        "the controller is too slow: median 50 us, the budget is 49 us; p99 900 us, the budget is "
        "899 us (of 200 decisions)",
        "the slowest: 1000 us, seed 0, at t = 0.071 s",
    )
    both.latency_budget(p99_us=901)
    assert both.compute_us(1.0) == pytest.approx(1000)


def test_without_a_decision_nothing_is_fast() -> None:
    at_once = run(trace([0.0], done="angle left"))
    fails(lambda: at_once.latency_budget(p99_us=1), "no decision was made")
    fails(at_once.never_ends, "ends at t = 0.000 s")


def test_claims_that_are_none_are_refused() -> None:
    one = run(trace(STEADY))
    with pytest.raises(EvsError, match="no sensor 'angel'; there is: angle"):
        one.never_leaves("angel", 0, 1)
    with pytest.raises(EvsError, match="give low <= high"):
        one.never_leaves("angle", 1, 0)
    with pytest.raises(EvsError, match=r"after_s of 0 \.\.\. 0\.01"):
        one.settles("angle", within=1, after_s=0.01)
    with pytest.raises(EvsError, match="give median_us="):
        one.latency_budget()


def test_a_trace_gives_its_sensors_by_name() -> None:
    one = trace(STEADY, pair=np.zeros((11, 2)))
    assert one.value("angle")[0] == 0.5
    assert one.values("pair").shape == (11, 2)
    assert one.t_s[-1] == pytest.approx(0.01)
    with pytest.raises(EvsError, match="has 2 numbers"):
        one.value("pair")


def test_a_run_tells_itself_in_a_line() -> None:
    told = str(run(trace(STEADY), trace(STEADY[:4], done="angle left")))
    assert told.startswith("1 of 2 seeds last 0.01 s; a decision takes 50 us (median)")
