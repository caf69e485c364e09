"""Stress cases that lack a resource: memory, room on a disk."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from evs.msgs import EvsError
from evs.tools.stress.capture import capture
from evs.tools.stress.machine.child import ProcessResult, emulate
from evs.tools.stress.machine.spinner import DOOM_TICK, SPINNER, TABLES
from evs.tools.stress.stress_case import Measurement, StressCase

_BURST = {"preset": "ideal", "width": 640, "height": 480, "pos_thres": 0.02, "neg_thres": 0.02}
"""[sensor]: 25 million events, 600 MB, in a tick in which a quarter of the picture goes dark"""
_MEMORY = 300_000_000
_LESS = (170_000_000, 100_000_000, 30_000_000, 10_000_000)
"""bytes beyond the bare program: enough until the burst; hardly, or too little, for the start"""
_ROOM = 65_536
"""bytes of disk"""


def _memory(short: bool) -> Measurement:
    """A burst of events of some GB in a process that may have less."""
    lost, messages = 0, ""
    calm = capture(SPINNER, DOOM_TICK * 1e-3, {"scene": {"keyframe": "doom"}, "sensor": _BURST,
                                            "render": {"spp": 1}}).events  # fmt: skip
    kept = calm[:0]
    for limit in (_MEMORY,) if short else (_MEMORY, *_LESS):
        ended = _emulate("doom", _BURST, 0.04, memory_bytes=limit)
        _check_ending(ended, limit)
        lost += _lost_events(ended, limit)
        if limit == _MEMORY:
            messages, kept = ended.errors[0], ended.recorded
    right = "do not fit in memory" in messages and 0 < len(calm) <= len(kept)
    return Measurement(
        lost, 0, "lost events", (messages,), right and bool((kept[: len(calm)] == calm).all())
    )


def _lost_events(ended: ProcessResult, limit: int) -> int:
    """Events that the recorder counted and the recording lacks, or has too many.

    Where little memory is left, none may be left for the report either: a warning must say so then.
    """
    if ended.report:
        return abs(sum(sink["events"] for sink in ended.report["sinks"]) - len(ended.recorded))
    if len(ended.recorded) and not any("report.json" in line for line in ended.warnings):
        raise EvsError(f"with {limit / 1e6:g} MB a run recorded events and reported nothing")
    return 0


def _disk(short: bool) -> Measurement:
    """A disk of 64 kB under a recording, while the bus is on."""
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
    *words: str,
    memory_bytes: int = 0,
    file_bytes: int = 0,
) -> ProcessResult:
    given = [f"sensor.{name}={value}" for name, value in sensor.items()]
    given += [f"scene.keyframe={key}", "threads=1", "render.spp=1", f"duration_s={seconds}", *words]
    with tempfile.TemporaryDirectory() as folder:
        return emulate(
            Path(folder), SPINNER, given, memory_bytes=memory_bytes, file_bytes=file_bytes
        )


def _check_ending(ended: ProcessResult, limit: int) -> None:
    """EvsError unless it ended with one line and exit code 2."""
    if ended.code != 2 or len(ended.errors) != 1 or not ended.errors[0].startswith("evs: "):
        raise EvsError(
            f"with {limit / 1e6:g} MB a run ended with code {ended.code} and "
            f"{len(ended.errors)} lines: {' | '.join(ended.errors[-3:])}"
        )


CASES = (
    StressCase(
        "memory-limit",
        "machine",
        "a burst of 600 MB of events where 300 MB are left; starts with 10, 30, 100 and 170 MB",
        "one line, exit code 2; every event that the recorder counted is read back, and those "
        "before the burst are those of a run without a limit",
        _memory,
    ),
    StressCase(
        "disk-full",
        "machine",
        "a recording on a disk with 64 kB of room (real ones: "
        "tests/drivers/files/test_*_full_disk.py)",
        "every event that the recorder counted is read back; one line says when it stopped, exit "
        "code 2; the camera and the bus go on",
        _disk,
    ),
)
