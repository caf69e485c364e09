"""A pacer on any clock that goes forward: it never says that the clock went back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.clock import Pacer

pytestmark = pytest.mark.property

seconds = st.sampled_from([0.0, 0.0, 1e-4, 2e-3, 0.2]) | st.floats(0.0, 1.0)
# ticks, ticks at once, and messages of a file that stand a little out of order
steps_us = st.sampled_from([1000, 1000, 100, 0, -500, 40_000])


@given(
    speed=st.sampled_from([0.1, 1.0, 3.0, 100.0]),
    catch_up_s=st.sampled_from([0.0, 0.01, 0.1]),
    start_s=st.sampled_from([0.0, 1e3, 1e7]),
    start_us=st.sampled_from([0, 2**31, 1_767_225_600_000_000]),
    told=st.booleans(),
    ticks=st.lists(st.tuples(seconds, steps_us, seconds), max_size=60),
)
def test_a_clock_that_goes_forward_never_went_back(
    speed: float,
    catch_up_s: float,
    start_s: float,
    start_us: int,
    told: bool,
    ticks: list[tuple[float, int, float]],
) -> None:
    """In: ticks, (work before it, us of it, by how much a sleep is too long)."""
    now, t_us, over_s = [start_s], start_us, [0.0]

    def sleep(wait_s: float) -> None:
        if wait_s > 0:
            now[0] += wait_s + over_s[0]

    pacer = Pacer(speed, lambda: now[0], sleep, catch_up_s=catch_up_s)
    if told:
        pacer.start(t_us)
    for work_s, step_us, late_s in ticks:
        now[0] += work_s
        t_us, over_s[0] = t_us + step_us, late_s
        pacer.wait_until(t_us)
    assert pacer.went_back_s == 0.0
