"""Outcomes, the registry of extremes, and a try that breaks down."""

from __future__ import annotations

import math

import pytest

from evs.msgs import EvsError
from evs.tools.stress import (
    GROUPS,
    CaseResult,
    Measurement,
    StressCase,
    cases_of,
    run_case,
    run_cases,
)


def test_an_outcome_holds_inside_its_limit_only() -> None:
    assert Measurement(1.0, 1.0).holds
    assert not Measurement(1.1, 1.0).holds
    assert not Measurement(math.nan, 1.0).holds
    assert not Measurement(0.0, 1.0, recovered=False).holds


def test_one_that_breaks_down_is_a_finding() -> None:
    def breaks(_short: bool) -> Measurement:
        raise EvsError("it broke\n  in two")

    tried = run_case(StressCase("one", "light", "", "", breaks))
    assert (tried.measurement, tried.error, tried.holds) == (
        None,
        "EvsError: it broke in two",
        False,
    )


def test_every_extreme_has_a_name_of_its_own_and_says_what_it_does() -> None:
    every = [case for group in GROUPS for case in cases_of(group)]
    assert len({case.name for case in every}) == len(every)
    for case in every:
        assert all((case.what, case.bound)), case.name
    for group in GROUPS:
        assert {case.group for case in cases_of(group)} == {group}


def test_an_unknown_group_is_refused_before_anything_runs() -> None:
    done: list[CaseResult] = []
    with pytest.raises(EvsError, match="lihgt"):
        run_cases(["light", "lihgt"], True, done.append)
    assert not done
