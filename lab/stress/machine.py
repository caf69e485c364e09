"""Stress cases of the machine: processor, clock, and resources that run out."""

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

from evs.drivers.clock import Pacer
from evs.emulator import World
from evs.msgs import Events, EvsError
from evs_lab.stress.capture import Capture, capture
from evs_lab.stress.child_process import ProcessResult, emulate
from evs_lab.stress.stress_case import Measurement, StressCase

SPINNER = """<mujoco><option gravity="0 0 0"/><visual><headlight active="0"/></visual><worldbody>
<light directional="true" dir="0.3 1 -0.2" diffuse="1 1 1" specular="0 0 0"/>
<camera name="eye" pos="0 -3 0" xyaxes="1 0 0 0 0 1" fovy="45"/>
<geom type="box" pos="0 1 0" size="9 .1 9" rgba=".8 .8 .8 1"/>
<body><joint type="hinge" axis="0 1 0"/><geom type="box" size=".6 .1 .06" rgba=".2 .3 .1 1"/></body>
<body pos="62 0 0"><joint type="slide" axis="1 0 0"/>
<geom type="box" size="40 .2 20" rgba="0 0 0 1"/></body>
</worldbody><keyframe><key name="calm" qvel="30 0"/><key name="doom" qvel="30 -1000"/></keyframe>
</mujoco>"""
"""A bar that physics alone spins. Key doom: after 20 ms all goes dark too, within 4 ms."""

DOOM_TICK = 20
"""number of ticks before it goes dark"""

TABLES: dict[str, Any] = {
    "scene": {"keyframe": "calm"},
    "sensor": {"preset": "davis346", "width": 96, "height": 72},
}
"""of the pipeline: a DAVIS346's pixels with their noise, and its readout"""


def spun(seconds: float, tables: Mapping[str, Any] | None = None, **more: Any) -> Capture:
    """Capture the spinner.

    Args:
        seconds: simulated time.
        tables: of the pipeline, over TABLES.
        more: further arguments of `capture`.
    """
    return capture(SPINNER, seconds, {**TABLES, **(tables or {})}, **more)


def _differing(a: Events, b: Events) -> int:
    """Count the events that differ, in their order; at least one where there are no events."""
    if not (len(a) and len(b)):
        return max(1, len(a), len(b))
    both = min(len(a), len(b))
    return int(np.count_nonzero(a[:both] != b[:both])) + abs(len(a) - len(b))


NO_AVX = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ",
    "NPY_DISABLE_CPU_FEATURES": "AVX AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL "
    "AVX512_ICL AVX512_SPR X86_V3 X86_V4",
}
"""environment variables that stop the C library and NumPy from using AVX"""


def _threads(short: bool) -> Measurement:
    """Compare one thread with two, and with more threads than cores."""
    seconds = 0.02 if short else 0.2
    many = 4 * (os.cpu_count() or 1) + 1
    one, *others = (spun(seconds, {"threads": count}) for count in (1, 2, many))
    wrong = sum(_differing(one.events, other.events) for other in others)
    return Measurement(
        wrong, 0, "differing events", (f"{len(one.events):,} events with 1, 2 and {many} threads",)
    )


def _portable(short: bool) -> Measurement:
    """Compare the portable path with the fastest of this machine, for all models and renderers."""
    seconds = 0.01 if short else 0.05
    wrong, made = 0, 0
    for tables in _EVERYTHING:
        auto, portable = (
            spun(seconds, {**tables, "render": {**tables["render"], "isa": isa}})
            for isa in ("auto", "portable")
        )
        wrong += _differing(auto.events, portable.events)
        made += len(auto.events)
    bare = _without_avx(seconds)
    auto = spun(seconds)
    wrong += _differing(auto.events, bare.recorded)
    messages = f"{made + len(auto.events):,} events, all identical"
    return Measurement(wrong, 0, "differing events", (messages,), bare.code == 0)


def _without_avx(seconds: float) -> ProcessResult:
    """Run in a process in which NumPy and the C library do not use AVX either."""
    arguments = [f"sensor.{key}={value}" for key, value in TABLES["sensor"].items()]
    arguments += ["scene.keyframe=calm", "threads=1", "render.isa=portable"]
    arguments.append(f"duration_s={seconds}")
    with tempfile.TemporaryDirectory() as folder:
        return emulate(Path(folder), SPINNER, arguments, environment=NO_AVX)


_SMALL = {**TABLES["sensor"], "width": 24, "height": 18}
_EVERYTHING: tuple[dict[str, Any], ...] = (
    {"render": {}},
    {"render": {"renderer": "path", "spp": 4}, "model": {"name": "adaptive"}},
    {"render": {"spp": 1}, "model": {"name": "evsnet"}, "sensor": _SMALL},
)
"""pipelines of the portable path: direct and plain, path and adaptive, the network"""


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
"""Start a number of processes that only compute; they end after a minute at the latest."""


def _stolen(short: bool) -> Measurement:
    """Sixteen processes compete for the core of a paced run, then end."""
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
    wrong = _differing(loaded.events, undisturbed.events)
    return Measurement(wrong, 0, "differing events", messages, right)


@contextmanager
def _one_core() -> Iterator[None]:
    """Bind this thread and the processes that it starts to one core, where the system can."""
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
    """Run so many busy processes on the cores of this thread."""
    load = subprocess.Popen(
        [sys.executable, "-P", "-S", "-c", BUSY, str(count)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        # not in a session of its own: Linux gives every session the same share of a core
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
    """A clock that jumps, and that sleeping and looking at it move; records the longest sleep."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.longest_s = 0.0

    def __call__(self) -> float:
        """Seconds."""
        self.now_s += 1e-6
        return self.now_s

    def sleep(self, seconds: float) -> None:
        """Sleep, but 0.1 s at most: an hour would be the error that the case looks for."""
        self.longest_s = max(self.longest_s, seconds)
        self.now_s += min(max(seconds, 0.0), 0.1)


def _jumps(short: bool) -> Measurement:
    """The clock by which a run is paced jumps an hour ahead, and two hours back."""
    ticks = 60 if short else 600
    speed = 0.5
    clock = JumpingClock()

    def jump(tick: int, _world: World) -> None:
        clock.now_s += {ticks // 3: 3600.0, 2 * ticks // 3: -7200.0}.get(tick, 0.0)

    pacer = Pacer(speed, clock, clock.sleep)
    paced = spun(ticks * 1e-3, act=jump, pace=pacer)
    still = spun(ticks * 1e-3)
    report = paced.report.pace
    slipped = any("has slipped 3.6e+03 s" in line for line in paced.warnings)
    back = any("clock went back by 7.2e+03 s" in line for line in paced.warnings)
    hours = 3599.0 < report["slipped_s"] < 3601.0 and 7199.0 < report["clock_back_s"] < 7201.0
    right = slipped and back and hours and not _differing(paced.events, still.events)
    return Measurement(1e3 * clock.longest_s, 1.0 / speed, "ms", paced.warnings, right)


_BURST = {"preset": "ideal", "width": 640, "height": 480, "pos_thres": 0.02, "neg_thres": 0.02}
"""[sensor]: 25 million events, 600 MB, in a tick in which a quarter of the picture goes dark"""
_MEMORY = 300_000_000
_LESS = (240_000_000, 225_000_000, 170_000_000, 10_000_000)
"""bytes beyond the bare program: enough until the burst; hardly enough, or too few, to start"""
_ROOM = 65_536
"""bytes of disk"""


def _memory(short: bool) -> Measurement:
    """Let a burst of events run out of memory."""
    lost, message = 0, ""
    calm = capture(SPINNER, DOOM_TICK * 1e-3, {"scene": {"keyframe": "doom"}, "sensor": _BURST,
                                            "render": {"spp": 1}}).events  # fmt: skip
    recorded = calm[:0]
    for limit in (_MEMORY,) if short else (_MEMORY, *_LESS):
        ended = _emulate("doom", _BURST, 0.04, memory_bytes=limit)
        _check_ending(ended, limit)
        lost += _lost_events(ended, limit)
        if limit == _MEMORY:
            message, recorded = ended.errors[0], ended.recorded
    right = "do not fit in memory" in message and 0 < len(calm) <= len(recorded)
    same = right and bool((recorded[: len(calm)] == calm).all())
    return Measurement(lost, 0, "lost events", (message,), same)


def _lost_events(ended: ProcessResult, limit: int) -> int:
    """Difference between the events that the recorder counted and those of the recording.

    Where memory is short, there may be none for the report either; then a warning must say so.
    """
    if ended.report:
        counted = sum(int(sink["events"]) for sink in ended.report["sinks"])
        return abs(counted - len(ended.recorded))
    if len(ended.recorded) and not any("run report" in line for line in ended.warnings):
        raise EvsError(f"with {limit / 1e6:g} MB a run recorded events and reported nothing")
    return 0


def _disk(short: bool) -> Measurement:
    """Record to a disk of 64 kB while the bus is on."""
    more = ["--publish", "tcp://127.0.0.1:0"]
    ended = _emulate("calm", TABLES["sensor"], 0.1 if short else 0.5, *more, file_bytes=_ROOM)
    kept = [one["events"] for one in ended.report["sinks"] if one.get("type") == "aedat4"]
    warned = [line for line in ended.warnings if "stopped after" in line]
    lost = abs(sum(kept) - len(ended.recorded))
    # the camera made every tick, and the bus had all of them
    report = ended.report
    right = report["ended"] == "complete" and len(warned) == 1 and ended.code == 2
    return Measurement(
        lost, 0, "lost events", tuple(warned), right and 0 < len(ended.recorded) < report["events"]
    )


def _emulate(
    key: str,
    sensor: Mapping[str, object],
    seconds: float,
    *arguments: str,
    memory_bytes: int = 0,
    file_bytes: int = 0,
) -> ProcessResult:
    words = [f"sensor.{name}={value}" for name, value in sensor.items()]
    words += [f"scene.keyframe={key}", "threads=1", "render.spp=1", f"duration_s={seconds}"]
    words += arguments
    with tempfile.TemporaryDirectory() as folder:
        return emulate(
            Path(folder), SPINNER, words, memory_bytes=memory_bytes, file_bytes=file_bytes
        )


def _check_ending(ended: ProcessResult, limit: int) -> None:
    """Raises EvsError unless it ended with one line and exit code 2."""
    if ended.code != 2 or len(ended.errors) != 1 or not ended.errors[0].startswith("evs: "):
        raise EvsError(
            f"with {limit / 1e6:g} MB a run ended with code {ended.code} and "
            f"{len(ended.errors)} lines: {' | '.join(ended.errors[-3:])}"
        )


CASES = (
    StressCase(
        "threads",
        "machine",
        "one thread, two threads, and four threads per core plus one",
        "the same bytes",
        _threads,
    ),
    StressCase(
        "no-avx",
        "machine",
        "no AVX: renderers, pixels and network take the portable path, and NumPy and the C library "
        "do not use AVX either",
        "the same bytes as on the fastest instruction set",
        _portable,
    ),
    StressCase(
        "stolen-time",
        "machine",
        "sixteen busy processes on the core of a run that is paced at a third of its free speed",
        "the same events as in an undisturbed run; a warning and the report state how far time has "
        "slipped; when the processes have ended, the run catches up",
        _stolen,
    ),
    StressCase(
        "clock-jumps",
        "machine",
        "the clock of a paced run jumps an hour ahead, then two hours back",
        "no wait is longer than a tick (2 ms at half speed), the events are the same, and both "
        "jumps are reported",
        _jumps,
    ),
    StressCase(
        "memory-limit",
        "machine",
        "a burst of 600 MB of events with 300 MB of memory left; runs that start with 10, 170, 225 "
        "and 240 MB left",
        "one line and exit code 2; every event that the recorder counted is read back, and the "
        "events before the burst equal those of a run without a limit",
        _memory,
    ),
    StressCase(
        "disk-full",
        "machine",
        "a recording on a disk with 64 kB of space left (for real disks, see "
        "tests/drivers/files/test_*_full_disk.py)",
        "every event that the recorder counted is read back; one line reports when the recording "
        "stopped; the camera and the bus continue; the exit code is 2",
        _disk,
    ),
)
