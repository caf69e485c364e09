"""Outcomes, the registry of extremes, and a try that breaks down."""

from __future__ import annotations

import math

import pytest

from evs.msgs import EvsError
from evs.tools.stress import (
    GROUPS,
    Extreme,
    Outcome,
    Tried,
    extremes_of,
    run_extremes,
    try_extreme,
)


def test_an_outcome_holds_inside_its_limit_only() -> None:
    assert Outcome(1.0, 1.0).holds
    assert not Outcome(1.1, 1.0).holds
    assert not Outcome(math.nan, 1.0).holds
    assert not Outcome(0.0, 1.0, recovered=False).holds


def test_one_that_breaks_down_is_a_finding() -> None:
    def breaks(_short: bool) -> Outcome:
        raise EvsError("it broke\n  in two")

    tried = try_extreme(Extreme("one", "light", "", "", breaks))
    assert (tried.outcome, tried.error, tried.holds) == (None, "EvsError: it broke in two", False)


def test_every_extreme_has_a_name_of_its_own_and_says_what_it_does() -> None:
    every = [extreme for group in GROUPS for extreme in extremes_of(group)]
    assert len({extreme.name for extreme in every}) == len(every)
    for extreme in every:
        assert all((extreme.what, extreme.bound)), extreme.name
    for group in GROUPS:
        assert {extreme.group for extreme in extremes_of(group)} == {group}


def test_an_unknown_group_is_refused_before_anything_runs() -> None:
    done: list[Tried] = []
    with pytest.raises(EvsError, match="lihgt"):
        run_extremes(["light", "lihgt"], True, done.append)
    assert not done
