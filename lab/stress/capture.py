"""Run a scene given as MJCF text through world, camera, run loop and recorder."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.clock import Pacer, StopWatch
from evs.drivers.files import read
from evs.drivers.run.config import check, load, make_sink
from evs.drivers.run.report import Report
from evs.drivers.run.run import run
from evs.emulator import World
from evs.emulator.config import decoding
from evs.msgs import EventPacket, Events, EvsError, join_events

IDEAL = {"preset": "ideal", "width": 32, "height": 24}
"""[sensor]: no noise, one threshold; the picture is small"""

Act = Callable[[int, World], None]
"""Called with (ticks done, world): before the first tick, then after each; it may move things."""


@dataclass(frozen=True)
class Capture:
    """A completed run."""

    report: Report
    events: Events
    """of the recording, equal to those of the camera"""
    world: World

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the report, equal to those that were emitted."""
        return tuple(self.report.warnings)

    def within(self, begin_us: int, end_us: int) -> Events:
        """The events in (begin_us, end_us]."""
        t = self.events["t"]
        return self.events[(t > begin_us) & (t <= end_us)]


def capture(
    mjcf: str,
    seconds: float,
    tables: Mapping[str, Any] | None = None,
    act: Act | None = None,
    suffix: str = ".aedat4",
    files: Mapping[str, bytes] | None = None,
    folder: Path | None = None,
    pace: Pacer | None = None,
    on_report: Callable[[Report], None] | None = None,
) -> Capture:
    """Emulate `seconds` of a scene as `evs emulate` would, recorder on.

    Args:
        mjcf: text of the scene.
        seconds: simulated time.
        tables: tables of the pipeline, over the IDEAL sensor in one thread.
        act: moves things before the first tick and after each.
        suffix: ending of the recording.
        files: name -> content of the files that the scene names.
        folder: where scene and recording (run + suffix) stay; None: a temporary folder.
        pace: paces the run; None: it runs freely.
        on_report: called with the report, also of a run that ends in an error.

    Raises:
        EvsError: as the run does, or the recording differs from the events of the camera.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = folder or Path(name)
        for file, content in (files or {}).items():
            (folder / file).write_bytes(content)
        scene = folder / "scene.xml"
        scene.write_text(mjcf, encoding="utf-8")
        target = folder / f"run{suffix}"
        return _capture(scene, seconds, dict(tables or {}), act, target, pace, on_report)


def differing(one: Capture, other: Capture) -> int:
    """Count the events that are in only one of the captures."""
    a, b = one.events, other.events
    return len(np.setxor1d(a, b)) + abs(len(a) - len(b))


def _capture(
    scene: Path,
    seconds: float,
    tables: dict[str, Any],
    act: Act | None,
    target: Path,
    pace: Pacer | None,
    on_report: Callable[[Report], None] | None,
) -> Capture:
    own = {"file": str(scene), **tables.pop("scene", {})}
    sensor = {**IDEAL, **tables.pop("sensor", {})}
    config = load(
        tables={
            "threads": 1,
            "record": str(target),
            "duration_s": seconds,
            "scene": own,
            "sensor": sensor,
            **tables,
        }
    )
    check(config)
    watch = StopWatch()
    with warnings.catch_warnings(record=True) as loading:
        warnings.simplefilter("always")
        world = World.from_config(config, meter=watch)
    if [str(warning.message) for warning in loading] != list(world.left_out):
        raise EvsError("what is left out is not what was warned of at loading")
    sent: list[Events] = []
    messages: list[str] = []

    def keep(tick: int, _world: Any, packets: tuple[EventPacket, ...]) -> None:
        sent.extend(packet.events for packet in packets)
        if act is not None:
            act(tick, world)

    if act is not None:
        act(0, world)
    sinks = [make_sink(sink) for sink in config.sinks()]
    report = run(
        world,
        sinks,
        seconds,
        watch,
        pace,
        observers=[keep],
        warn=messages.append,
        on_report=on_report,
        config=decoding.to_plain(config),
    )
    if [line for line in report.warnings if line not in world.left_out] != messages:
        raise EvsError("the report's warnings are not those that were said")
    events = join_events(sent)
    if not np.array_equal(read(target), events):
        raise EvsError(f"{target.name} has other events than left the camera")
    return Capture(report, events, world)
