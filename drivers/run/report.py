"""The run report: what a run did and how long it took. Every run writes the same fields."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.metadata
import json
import platform
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evs.drivers.clock import StageTime
from evs.msgs import EvsError


@dataclass(frozen=True)
class Progress:
    """Where a run is, after a tick."""

    tick: int
    """ticks done"""
    ticks: int
    """ticks wanted"""
    sim_seconds: float
    events: int
    """so far"""
    wall_seconds: float
    """so far"""


STAGES = ("world", "render", "sensor", "pack", "sink")
"""The stages of a tick, in their order. `pack` is events into packets and packets into bytes."""

PACKAGES = ("evs", "mujoco", "numpy", "msgpack", "pyzmq", "flatbuffers", "lz4", "zstandard")
"""Packages whose versions a report names, where they are installed."""

COMPLETE = "complete"
"""`ended` of a run that made all its ticks."""


@dataclass(frozen=True)
class Report:
    """What a run did. Counts are over all cameras."""

    ended: str = COMPLETE
    """complete, or why it ended early"""
    real_time_factor: float = 0.0
    """sim_seconds / wall_seconds"""
    ticks: int = 0
    sim_seconds: float = 0.0
    wall_seconds: float = 0.0
    """from the first tick's begin to the last packet's end; opening and closing sinks left out"""
    packets: int = 0
    events: int = 0
    """events that left the sensors"""
    events_dropped: int = 0
    """events that a readout or a sink's full queue lost"""
    events_waiting: int = 0
    """events that were still on their way through a readout at the end"""
    stage_ms: dict[str, StageTime] = field(default_factory=dict)
    """STAGES -> ms per tick, all cameras together; waiting for the pace belongs to none, nor does
    waiting for light that is made ahead: world and render may then overlap with the others"""
    traced_fraction: float = 0.0
    """share of the pixels that were traced, mean over ticks and cameras"""
    clamps: int = 0
    """values that a stage had to clamp or replace (NaN, infinite light)"""
    seed: int = 0
    substeps: str = ""
    """how the model's time step was fitted to the tick"""
    cameras: list[dict[str, Any]] = field(default_factory=list)
    """for each camera: name, sensor, parameters (of the sensor, resolved), width, height, tick_us,
    latency_us (of the event model; the stamps carry it), events, ..., rebuilt (how often its scene
    was built again, as the model was edited: scenes, and of these meshes and textures),
    camera_info, plan (what its scene contains, which code paths ran, and why the others did not:
    `evs plan`)"""
    sinks: list[dict[str, Any]] = field(default_factory=list)
    """what each sink reported when it was closed"""
    pace: dict[str, Any] = field(default_factory=dict)
    """held to the wall clock: speed, catch_up_s, late_ms {median, p99, worst} over all ticks,
    slipped_s and slips: by how much simulated time fell behind for good, and in how many ticks,
    clock_back_s: by how much the machine's clock went back, which none should"""
    loop: dict[str, Any] = field(default_factory=dict)
    """lock-step: address, episodes, steps, restores, saves, controllers (that joined), ..._lost,
    refused and repeated requests, decision_ms {median, p99} that the world waited for each, and
    packets and events that the delay model lost, the files that were recorded"""
    sensor_changes: list[dict[str, Any]] = field(default_factory=list)
    """parameters that a client changed: t_us, from which on they hold, camera, values"""
    warnings: list[str] = field(default_factory=list)
    versions: dict[str, str] = field(default_factory=dict)
    config: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> str:
        """Indented JSON text; every value is finite."""
        return (
            json.dumps(dataclasses.asdict(self), indent=2, allow_nan=False, default=_plain) + "\n"
        )


def _plain(value: Any) -> Any:
    """numpy's scalars and arrays as plain values; anything else as its text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def versions() -> dict[str, str]:
    """Version of Python and of each of PACKAGES that is installed."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def write_report(report: Report, path: str | Path) -> None:
    """Write the report; what stood there before stays whole until the new one is complete."""
    write_whole(report.to_json(), path)


def write_whole(text: str, path: str | Path) -> None:
    """Write a report's text; what stood there before stays whole until it is complete."""
    target = Path(path)
    part = target.with_name(target.name + ".part")
    try:
        # devices and pipes (/dev/stdout) cannot be replaced, only written
        if target.exists() and not target.is_file():
            target.write_text(text, encoding="utf-8")
            return
        part.write_text(text, encoding="utf-8")
        part.replace(target)
    except OSError as reason:
        with contextlib.suppress(OSError):
            part.unlink()
        raise EvsError(f"cannot write '{target}': {reason.strerror}") from None


def check_targets(paths: Iterable[str | Path]) -> None:
    """Refuse files that could not be written, before the run rather than after it."""
    for path in map(Path, paths):
        if path.is_dir():
            raise EvsError(f"cannot write '{path}': it is a folder")
        if not path.parent.is_dir():
            folder = f"'{path.parent}'"
            there = (
                f"{folder} is no folder"
                if path.parent.exists()
                else (f"there is no folder {folder} (mkdir -p makes it)")
            )
            raise EvsError(f"cannot write '{path}': {there}")
        is_new = not path.exists()
        try:
            with path.open("ab"):
                pass
        except OSError as reason:
            raise EvsError(f"cannot write '{path}': {reason.strerror}") from None
        if is_new:
            path.unlink(missing_ok=True)


def report_beside(recording: str | Path) -> Path:
    """Where the report of a recording stands: FILE.report.json."""
    return Path(f"{recording}.report.json")
