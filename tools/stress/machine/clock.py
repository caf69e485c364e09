"""Time that others take, and clocks that jump."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from evs.drivers.clock import Pacer, monotonic_s, sleep_s
from evs.emulator import World
from evs.tools.stress.machine.spinner import differing, spun
from evs.tools.stress.stress_case import Measurement, StressCase

BUSY = """
import os, signal, sys
for _ in range(int(sys.argv[1]) - 1):
    if not os.fork():
        break
else:
    print(flush=True)
signal.alarm(60)
while True:
    pass
"""
"""So many processes that do nothing but work; whatever becomes of us, they end in a minute."""


def _stolen(short: bool) -> Measurement:
    """Sixteen others want this core while a run has to keep its pace; then they are gone."""
    free = spun(0.1)
    # a third of what is possible: easy alone, out of reach with a seventeenth of the core
    speed = free.report.real_time_factor / 3.0
    ticks = int((0.4 if short else 1.0) * 1000 * speed)
    pacer = Pacer(speed)
    late_s: list[float] = []
    with ExitStack() as load:
        load.enter_context(_one_core())
        load.enter_context(_busy(16))

        def watch(tick: int, _world: World) -> None:
            late_s.append(pacer.late_s)
            if tick == ticks // 2:
                load.close()

        loaded = spun(ticks * 1e-3, act=watch, pace=pacer)
        undisturbed = spun(ticks * 1e-3)
    caught_up = min(late_s[ticks // 2 + 1 :], default=1.0) == 0.0
    warned = [line for line in loaded.warnings if "cannot keep up" in line]
    pace = loaded.report.pace
    messages = (*warned[:1], f"slips: {pace['slips']}, slipped_s: {pace['slipped_s']}")
    right = caught_up and len(warned) > 0 and pace["slips"] > 0
    wrong = differing(loaded.events, undisturbed.events)
    return Measurement(wrong, 0, "other events", messages, right)


@contextmanager
def _one_core() -> Iterator[None]:
    """This thread and the processes that it starts have one core, where the system can do that."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def _busy(count: int) -> Iterator[None]:
    """So many of them, on the cores that this thread has."""
    load = subprocess.Popen(
        [sys.executable, "-P", "-S", "-c", BUSY, str(count)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        # no session of their own: Linux gives each session the same share, however many it holds
        process_group=0,
    )
    try:
        if load.stdout is not None:
            load.stdout.readline()
        yield
    finally:
        os.killpg(load.pid, signal.SIGKILL)
        load.communicate()


class JumpingClock:
    """The machine's monotonic clock, put forward or back at will, and what was slept by it."""

    def __init__(self) -> None:
        self.ahead_s = 0.0
        self.longest_s = 0.0

    def __call__(self) -> float:
        """Seconds."""
        return monotonic_s() + self.ahead_s

    def sleep(self, seconds: float) -> None:
        """As long as it is asked, but never for an hour: that would be the fault looked for."""
        self.longest_s = max(self.longest_s, seconds)
        sleep_s(min(seconds, 0.1))


def _jumps(short: bool) -> Measurement:
    """The clock by which a run is paced jumps an hour ahead, and two hours back."""
    ticks = 60 if short else 600
    speed = 0.5
    clock = JumpingClock()

    def jump(tick: int, _world: World) -> None:
        clock.ahead_s += {ticks // 3: 3600.0, 2 * ticks // 3: -7200.0}.get(tick, 0.0)

    pacer = Pacer(speed, clock, clock.sleep)
    paced = spun(ticks * 1e-3, act=jump, pace=pacer)
    still = spun(ticks * 1e-3)
    report = paced.report.pace
    slipped = any("has slipped 3.6e+03 s" in line for line in paced.warnings)
    back = any("clock went back by 7.2e+03 s" in line for line in paced.warnings)
    hours = 3599.0 < report["slipped_s"] < 3601.0 and 7199.0 < report["clock_back_s"] < 7201.0
    right = slipped and back and hours and not differing(paced.events, still.events)
    return Measurement(1e3 * clock.longest_s, 1.0 / speed, "ms", paced.warnings, right)


CASES = (
    StressCase(
        "stolen-time",
        "machine",
        "sixteen busy processes on the core of a run that is held to a third of its speed",
        "the same events as undisturbed; a warning and the report tell by how much time slipped; "
        "when they are gone it catches up",
        _stolen,
    ),
    StressCase(
        "clock-jumps",
        "machine",
        "the clock of a paced run jumps an hour ahead, then two hours back",
        "no wait is longer than a tick (2 ms at half speed), and the events are the same; both "
        "jumps are told",
        _jumps,
    ),
)
