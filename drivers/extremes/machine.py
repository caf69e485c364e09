"""The extremes of the machine: threads, instruction sets, stolen time, clocks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.extremes.child import Ended, emulate
from evs.drivers.extremes.extreme import Extreme, Outcome
from evs.drivers.extremes.film import Film, film
from evs.drivers.extremes.scarce import SCARCE
from evs.drivers.extremes.spinner import SPINNER, TABLES
from evs.drivers.pace import Pacer, monotonic_s, sleep_s
from evs.emulator import World
from evs.msgs import Events

NO_AVX = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ",
    "NPY_DISABLE_CPU_FEATURES": "AVX AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL "
    "AVX512_ICL AVX512_SPR X86_V3 X86_V4",
}
"""environment: instructions that the C library and NumPy are not to use"""


def differing(a: Events, b: Events) -> int:
    """How many events of one are not those of the other; all are where there are none at all."""
    if not (len(a) and len(b)):
        return max(1, len(a), len(b))
    both = min(len(a), len(b))
    return int(np.count_nonzero(a[:both] != b[:both])) + abs(len(a) - len(b))


def _threads(short: bool) -> Outcome:
    """One thread, two, and more than there are cores."""
    seconds = 0.02 if short else 0.2
    many = 4 * (os.cpu_count() or 1) + 1
    one, *others = (_spun(seconds, {"threads": count}) for count in (1, 2, many))
    wrong = sum(differing(one.events, other.events) for other in others)
    return Outcome(
        wrong, 0, "other events", (f"{len(one.events):,} events with 1, 2, {many} threads",)
    )


def _spun(seconds: float, tables: Mapping[str, Any] | None = None, **more: Any) -> Film:
    return film(SPINNER, seconds, {**TABLES, **(tables or {})}, **more)


def _stolen(short: bool) -> Outcome:
    """Sixteen others want this core while a run has to keep its pace; then they are gone."""
    free = _spun(0.1)
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

        loaded = _spun(ticks * 1e-3, act=watch, pace=pacer)
        undisturbed = _spun(ticks * 1e-3)
    caught_up = min(late_s[ticks // 2 + 1 :], default=1.0) == 0.0
    said = [line for line in loaded.warnings if "cannot keep up" in line]
    pace = loaded.report.pace
    told = (*said[:1], f"slips: {pace['slips']}, slipped_s: {pace['slipped_s']}")
    right = caught_up and len(said) > 0 and pace["slips"] > 0
    wrong = differing(loaded.events, undisturbed.events)
    return Outcome(wrong, 0, "other events", told, right)


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


@contextmanager
def _busy(count: int) -> Iterator[None]:
    """So many of them, on the cores that this thread has."""
    load = subprocess.Popen(
        [sys.executable, "-S", "-c", BUSY, str(count)],
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


def _jumps(short: bool) -> Outcome:
    """The clock by which a run is paced jumps an hour ahead, and two hours back."""
    ticks = 60 if short else 600
    speed = 0.5
    clock = JumpingClock()

    def jump(tick: int, _world: World) -> None:
        clock.ahead_s += {ticks // 3: 3600.0, 2 * ticks // 3: -7200.0}.get(tick, 0.0)

    pacer = Pacer(speed, clock, clock.sleep)
    paced = _spun(ticks * 1e-3, act=jump, pace=pacer)
    still = _spun(ticks * 1e-3)
    report = paced.report.pace
    slipped = any("has slipped 3.6e+03 s" in line for line in paced.warnings)
    back = any("clock went back by 7.2e+03 s" in line for line in paced.warnings)
    hours = 3599.0 < report["slipped_s"] < 3601.0 and 7199.0 < report["clock_back_s"] < 7201.0
    right = slipped and back and hours and not differing(paced.events, still.events)
    return Outcome(1e3 * clock.longest_s, 1.0 / speed, "ms", paced.warnings, right)


def _portable(short: bool) -> Outcome:
    """All models and renderers on the portable path, beside the fastest that this machine has."""
    seconds = 0.01 if short else 0.05
    wrong, made = 0, 0
    for tables in _EVERYTHING:
        auto, portable = (
            _spun(seconds, {**tables, "render": {**tables["render"], "isa": isa}})
            for isa in ("auto", "portable")
        )
        wrong += differing(auto.events, portable.events)
        made += len(auto.events)
    bare = _without_avx(seconds)
    auto = _spun(seconds)
    wrong += differing(auto.events, bare.recorded)
    said = f"{made + len(auto.events):,} events, each the same"
    return Outcome(wrong, 0, "other events", (said,), bare.code == 0)


def _without_avx(seconds: float) -> Ended:
    """A process in which NumPy and the C library are told that there is no AVX either."""
    given = [f"sensor.{key}={value}" for key, value in TABLES["sensor"].items()]
    given += ["scene.keyframe=calm", "threads=1", "render.isa=portable", f"duration_s={seconds}"]
    with tempfile.TemporaryDirectory() as folder:
        return emulate(Path(folder), SPINNER, given, environment=NO_AVX)


_SMALL = {**TABLES["sensor"], "width": 24, "height": 18}
_EVERYTHING: tuple[dict[str, Any], ...] = (
    {"render": {}},
    {"render": {"renderer": "path", "spp": 4}, "model": {"name": "adaptive"}},
    {"render": {"spp": 1}, "model": {"name": "evsnet"}, "sensor": _SMALL},
)
"""what the portable path is tried with: direct and plain, path and adaptive, the network"""


EXTREMES = (
    Extreme(
        "threads",
        "machine",
        "one thread, two, and four for each core and one more",
        "the same bytes",
        _threads,
    ),
    Extreme(
        "no-avx",
        "machine",
        "no AVX: renderers, pixels and network on the portable path; NumPy and the C library "
        "without it too",
        "the same bytes as on the fastest instruction set",
        _portable,
    ),
    Extreme(
        "stolen-time",
        "machine",
        "sixteen busy processes on the core of a run that is held to a third of its speed",
        "the same events as undisturbed; a warning and the report tell by how much time slipped; "
        "when they are gone it catches up",
        _stolen,
    ),
    Extreme(
        "clock-jumps",
        "machine",
        "the clock of a paced run jumps an hour ahead, then two hours back",
        "no wait is longer than a tick (2 ms at half speed), and the events are the same; both "
        "jumps are told",
        _jumps,
    ),
    *SCARCE,
)
