"""Stress cases: measurements, groups, failures; each case at full length; their bus player."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.bus import Subscription
from evs.drivers.bus import subscribe as real
from evs.drivers.clock import sleep_s
from evs.drivers.files import recorder_for
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events
from evs_lab.stress import (
    GROUPS,
    CaseResult,
    Measurement,
    StressCase,
    cases_of,
    run_case,
    run_cases,
)
from evs_lab.stress import time as time_cases


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


MINUTES = ("a-million-resets", "a-day")
"""cases that take them"""


@pytest.mark.extremes
@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            marks=[pytest.mark.campaign] if case.name in MINUTES else [],
            id=f"{case.group}-{case.name}",
        )
        for group in GROUPS
        for case in cases_of(group)
    ],
)
def test_a_stress_case_keeps_its_bound(case: StressCase) -> None:
    result = run_case(case)
    assert result.holds, (result.measurement, result.error)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name)
        # those of the machine need it for themselves
        for group in GROUPS
        if group != "machine"
        for case in cases_of(group)
    ],
)
def test_evs_doctor_finds_that_it_keeps_its_bound(case: StressCase) -> None:
    result = run_case(case, short=True)
    assert result.holds, (result.measurement, result.error)


def test_a_listener_on_a_busy_machine_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = 20_000
    recorder = recorder_for(tmp_path / "run.aedat4")
    recorder.open([StreamInfo(width=8, height=8)])
    for tick in range(count):
        at = np.array([1000 * tick + 500])
        events = make_events(at, np.array([1]), np.array([2]), np.array([1]))
        recorder.write(EventPacket(tick, 1000 * tick, 1000 * tick + 1000, 8, 8, events))
    recorder.close()

    @contextmanager
    def slow(*args: Any, **named: Any) -> Iterator[Subscription]:
        with real(*args, **named) as subscription:
            sleep_s(2.0)
            yield subscription

    monkeypatch.setattr(time_cases, "subscribe", slow)
    events, lost = time_cases._played(tmp_path / "run.aedat4")
    assert (len(events), lost) == (count, 0)
