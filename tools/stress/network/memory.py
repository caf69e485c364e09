"""A membrane that forgets at once, or hardly ever."""

from __future__ import annotations

import math

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F32, F64
from evs.msgs import EvsError
from evs.tools.stress.network.known_networks import (
    STEP,
    capture_network,
    later,
    membranes,
    refused,
    through,
)
from evs.tools.stress.step_target import OPEN, SHUT
from evs.tools.stress.stress_case import Measurement, StressCase

LONGEST_TAU_S = 15.1
"""at a tick of 1 ms: the decay's tables end 2^20 ticks on, where 2^-100 must be left at most"""
ROUNDINGS = 4.5
"""of 2^-24: two of the tables, two of the products, and half a one of the sum"""


def _forgetful(short: bool) -> Measurement:
    """A membrane that forgets all within a tick: it fires where one step alone is enough."""
    ticks = 40 if short else 400
    wrong, clamps = 0, 0
    for tau_s, enough, each in ((1e-6, 1.1, 1), (1e-6, 0.9, 0), (1e-300, 1.1, 1)):
        network = through(enough / STEP, tau_s)
        seen = capture_network(network, lambda tick: SHUT if tick % 2 else OPEN, ticks)
        on, off = seen.counts()
        wrong += int(np.abs(on + off - each * (ticks - 1)).sum())
        clamps += seen.capture.report.clamps
    return Measurement(wrong, 0, "wrong events", (f"{clamps} values clamped",))


def _left_over(tau_s: float, quiet: int, real: bool = False) -> tuple[F32, F64]:
    """V after a step of 0.9 down, so many quiet ticks and the same step up; and by the closed form.

    In: real, whether these ticks are run, or the network's clock is put forward.
    """
    ticks = 2 + quiet if real else 2
    before: list[F32] = []

    def watch(tick: int, world: World) -> None:
        if tick == 2:
            before.append(membranes(world))
            if not real:
                later(world, quiet)

    def left(tick: int) -> float:
        return SHUT if 1 <= tick < ticks else OPEN

    seen = capture_network(through(0.9 / STEP, tau_s), left, ticks + 1, watch)
    if len(seen.capture.events):
        raise EvsError("a step of 0.9 thresholds had an event")
    exact = before[0].astype(np.float64)
    waited_s = (quiet + 1) * 1e-3
    return membranes(seen.capture.world), exact * (math.exp(-waited_s / tau_s) - 1.0)


def _waits(tau_s: float, waits: tuple[int, ...]) -> float:
    """By how many roundings of float32 V is off at most."""
    pairs = [_left_over(tau_s, quiet) for quiet in waits]
    return max(float(np.abs(v - exact).max()) for v, exact in pairs) * 2.0**24


def _long_memory(short: bool) -> Measurement:
    """The longest time constant there is; and one that is longer."""
    waits = (1000, 10**6) if short else (0, 255, 256, 1000, 10**4, 10**5, 10**6, 2**20)
    off_by = _waits(LONGEST_TAU_S, waits)
    refusal = refused(
        lambda: capture_network(through(1.0, 1.01 * LONGEST_TAU_S), lambda _tick: OPEN, 2)
    )
    named = "tau_s is 15.251" in refusal and "15.1 s" in refusal
    return Measurement(off_by, ROUNDINGS, "roundings", (refusal,), named)


def _quiet(short: bool) -> Measurement:
    """A billion ticks in which nothing moves: 11.6 days."""
    off_by = _waits(0.5, (10**9,) if short else tuple(10**k for k in range(10)))
    # ticks that are run leave the same bits as a clock that is put forward
    count = 200 if short else 5000
    ran, put = (_left_over(0.5, count, real)[0] for real in (True, False))
    return Measurement(
        off_by, ROUNDINGS, "roundings", ("no event",), ran.tobytes() == put.tobytes()
    )


CASES = (
    StressCase(
        "tau-shortest",
        "network",
        "time constants of 1e-6 and 1e-300 s, ticks of 1 ms, steps of 1.1 and of 0.9 thresholds",
        "an event for each step of 1.1, none for 0.9: e^-1000 is nothing",
        _forgetful,
    ),
    StressCase(
        "tau-longest",
        "network",
        "a time constant of 15.1 s, the longest for ticks of 1 ms, and waits up to 2^20 ticks",
        "V is V e^(-t / tau) but for 4.5 roundings of 2^-24; a longer tau is refused in a line",
        _long_memory,
    ),
    StressCase(
        "quiet-1e9-ticks",
        "network",
        "a billion quiet ticks (11.6 days) between two steps of light",
        "V is V e^(-t / tau) but for 4.5 roundings of 2^-24; ticks that are run leave the same "
        "bits as ticks that are skipped",
        _quiet,
    ),
)
