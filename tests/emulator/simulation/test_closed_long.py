"""Four minutes of simulated time in lock-step, in a program of its own: memory stays."""

from __future__ import annotations

import pytest

from reference.lockstep_minutes import check, run

pytestmark = pytest.mark.integration


def test_twenty_seconds_in_lock_step():
    said = run(16, 20_000)
    check(said, 20_000)
    assert said["events"] > 20_000  # type: ignore[operator]


@pytest.mark.campaign
def test_four_minutes_in_lock_step():
    said = run(24, 240_000)
    check(said, 240_000)
