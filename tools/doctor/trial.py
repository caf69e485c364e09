"""A trial run: a pendulum through renderer, sensor, bus and recorder; the time of a tick."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.bus import subscribe
from evs.drivers.bus.address import free_address
from evs.drivers.clock import StopWatch
from evs.drivers.files import read
from evs.drivers.run.config import load, make_sink
from evs.drivers.run.report import Report
from evs.drivers.run.run import run
from evs.emulator import World
from evs.msgs import EventPacket, Events, join_events
from evs.tools.doctor.check import BAD, OK, Check

SCENE = Path(__file__).parents[2] / "config" / "scenes" / "pendulum.xml"

TRIAL_S = 0.2
"""simulated seconds of the trial run"""

TIMING_S = 0.1
"""simulated seconds of the run that is timed"""

REPORT_FIX = "run `evs doctor --json` and report what it prints as an issue"


@dataclass
class _Listener:
    """A subscriber in a thread of its own."""

    address: str
    packets: int = 0
    events: int = 0
    lost: int = 0
    ended: bool = False
    failure: str = ""
    thread: threading.Thread = field(init=False)

    def __post_init__(self) -> None:
        self.thread = threading.Thread(target=self._listen, daemon=True)
        self.thread.start()

    def _listen(self) -> None:
        try:
            with subscribe(self.address, timeout_s=20.0) as subscription:
                for packet in subscription:
                    self.packets += 1
                    self.events += len(packet)
                self.lost, self.ended = subscription.lost, subscription.ended
        except Exception as reason:
            self.failure = str(reason)


def check_pipeline(folder: Path) -> list[Check]:
    """Run a pendulum through renderer, sensor, bus and recorder; a check for each.

    Args:
        folder: for the recording.
    """
    file = folder / "trial.aedat4"
    address = free_address()
    config = load(
        tables={
            "scene": {"file": str(SCENE), "camera": "front"},
            "sensor": {"preset": "davis346", "width": 96, "height": 72},
            "sink": [
                {"type": "zmq", "address": address, "wait_for": 1},
                {"type": "aedat4", "file": str(file)},
            ],
            "duration_s": TRIAL_S,
        }
    )
    watch = StopWatch()
    world = World.from_config(config, meter=watch)
    listener = _Listener(address)
    sent: list[Events] = []

    def keep(_tick: int, _world: World, packets: tuple[EventPacket, ...]) -> None:
        sent.extend(packet.events for packet in packets)

    sinks = [make_sink(sink) for sink in config.sinks()]
    report = run(world, sinks, TRIAL_S, watch, observers=[keep])
    listener.thread.join(timeout=30.0)
    return [
        _renderer(world, report),
        _sensor(report),
        _bus(report, listener),
        _recorder(join_events(sent), file),
    ]


def check_timing() -> Check:
    """Measure the time of a tick of a davis346 on a simple scene; it is never a fault."""
    config = load(
        tables={
            "scene": {"file": str(SCENE), "camera": "front"},
            "sensor": {"preset": "davis346"},
            "duration_s": TIMING_S,
        }
    )
    watch = StopWatch()
    report = run(World.from_config(config, meter=watch), [], TIMING_S, watch)
    stages = {name: times.median for name, times in report.stage_ms.items() if times.median}
    text = ", ".join(f"{name} {ms:.2f}" for name, ms in stages.items())
    return Check(
        "timing",
        OK,
        f"{sum(stages.values()):.2f} ms a tick of 1 ms, davis346 on a simple scene ({text})",
    )


def _renderer(world: Any, report: Report) -> Check:
    if world.cameras[0].is_dark:
        return Check("renderer", BAD, "the picture of a lit scene is black", REPORT_FIX)
    return Check("renderer", OK, f"{report.ticks} pictures of a lit pendulum")


def _sensor(report: Report) -> Check:
    if not report.events:
        return Check("sensor", BAD, "a moving pendulum made no event", REPORT_FIX)
    return Check("sensor", OK, f"{report.events:,} events in {report.sim_seconds:g} s")


def _bus(report: Report, listener: _Listener) -> Check:
    fix = "let the firewall pass connections to 127.0.0.1"
    if listener.failure:
        return Check("bus", BAD, listener.failure, fix)
    says = f"{listener.packets} of {report.packets} packets, {listener.events:,} events received"
    complete = listener.ended and (listener.packets, listener.events) == (
        report.packets,
        report.events,
    )
    if not complete or listener.lost:
        return Check("bus", BAD, says, fix)
    return Check("bus", OK, says)


def _recorder(sent: Events, file: Path) -> Check:
    recorded = read(file)
    if not np.array_equal(recorded, sent):
        says = f"{len(recorded):,} of {len(sent):,} events read back, or others"
        return Check("recorder", BAD, says, REPORT_FIX)
    return Check("recorder", OK, f"{len(sent):,} events read back from {file.suffix} unchanged")
