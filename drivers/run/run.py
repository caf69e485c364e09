"""The run loop: step the world, hand its packets to the sinks, however it ends close them all."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from evs.drivers.clock import Pacer, StopWatch, monotonic_s
from evs.drivers.run.pace_monitor import PaceMonitor
from evs.drivers.run.report import COMPLETE, Report
from evs.drivers.run.sink_set import SinkSet
from evs.drivers.run.statistics import RunStatistics, RunWorld
from evs.drivers.run.stop_signals import stop_signals
from evs.drivers.sink import Sink
from evs.msgs import EventPacket, EvsError, StreamInfo

MAX_SECONDS = 1e9
"""Longer than 30 years is a mistake, not a run."""


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


Observer = Callable[[int, Any, tuple[EventPacket, ...]], None]
"""Called after every tick with (tick from 1, world, packets); its time belongs to no stage."""


def tick_count(duration_s: float, tick_us: int) -> int:
    """The whole ticks nearest to a duration. Raises EvsError where that is none or impossible."""
    if tick_us < 1:
        raise EvsError(f"at scene.tick_us: {tick_us} is no tick; give 1 us or more")
    if not (math.isfinite(duration_s) and 0 < duration_s <= MAX_SECONDS):
        raise EvsError(
            f"at duration_s: {duration_s:g} s is not possible; give more than 0 s, "
            f"and {MAX_SECONDS:g} s at most"
        )
    ticks = round(duration_s * 1e6 / tick_us)
    if not ticks:
        raise EvsError(
            f"at duration_s: {duration_s:g} s is less than half a tick of {tick_us} us; "
            "give a longer duration or a shorter scene.tick_us"
        )
    return ticks


def run(
    world: RunWorld,
    sinks: Sequence[Sink],
    duration_s: float,
    meter: StopWatch | None = None,
    pace: Pacer | None = None,
    progress: Callable[[Progress], None] | None = None,
    observers: Sequence[Observer] = (),
    *,
    begun: Callable[[], None] | None = None,
    warn: Callable[[str], None] | None = None,
    on_report: Callable[[Report], None] | None = None,
    config: Mapping[str, Any] | None = None,
) -> Report:
    """Run a world for `duration_s` of simulated time, whole ticks, and report.

    In: `meter` is the one the world laps. `config` stands in the report. `begun` is called once all
    sinks are open, before the first tick. `warn` gets a line for each thing that is legal but
    hardly meant. `on_report` gets the report exactly once, after all sinks are closed, however the
    run ends; a run whose sinks did not open never began.
    Ctrl-C and SIGTERM end the run after the current tick: the report's `ended` says so. An error
    (EvsError from physics or a sink, anything else) is raised after every sink was closed, so
    that what was recorded until then is complete.
    """
    infos = [camera.info for camera in world.cameras]
    loop = _Loop(world, sinks, meter or StopWatch(), pace or Pacer(), warn)
    failure: BaseException | None = None
    try:
        ticks = tick_count(duration_s, infos[0].tick_us if infos else 1000)
        loop.open(infos)
        if begun is not None:
            begun()
        loop.ticks(ticks, progress, observers)
    except KeyboardInterrupt:
        loop.ended = f"interrupted at {loop.sim_seconds:.6g} s"
    except BaseException as error:
        loop.ended = f"error at {loop.sim_seconds:.6g} s: {error or type(error).__name__}"
        failure = error
    closing = loop.close()
    if isinstance(closing, KeyboardInterrupt):
        loop.ended = f"interrupted at {loop.sim_seconds:.6g} s, while closing"
    elif closing is not None and failure is None:
        loop.ended, failure = f"error while closing: {closing}", closing
    report = loop.statistics.report(
        ended=loop.ended,
        sim_seconds=loop.sim_seconds,
        wall_seconds=loop.wall_seconds,
        sinks=loop.sinks.reports,
        pace=loop.pacer.report(),
        warnings=loop.warnings,
        config=dict(config or {}),
    )
    if on_report is not None and loop.began:
        on_report(report)
    if failure is not None:
        raise failure
    return report


class _Loop:
    """The state of one run."""

    def __init__(
        self,
        world: RunWorld,
        sinks: Sequence[Sink],
        watch: StopWatch,
        pacer: Pacer,
        warn: Callable[[str], None] | None,
    ) -> None:
        self.world, self.watch, self.pacer, self.warn = world, watch, pacer, warn
        self.sinks = SinkSet(sinks, watch, self._warn)
        self.pace_monitor = PaceMonitor(pacer, self._warn)
        self.ended = COMPLETE
        self.began = False
        self.statistics = RunStatistics(world, watch)
        self.begin_us = world.t_us
        self.wall_seconds = 0.0
        self.warnings = list(world.left_out)

    @property
    def done(self) -> int:
        return self.statistics.ticks

    @property
    def sim_seconds(self) -> float:
        return (self.world.t_us - self.begin_us) / 1e6

    def open(self, infos: Sequence[StreamInfo]) -> None:
        self.sinks.open(infos)
        self.began = True

    def ticks(
        self,
        ticks: int,
        progress: Callable[[Progress], None] | None,
        observers: Sequence[Observer],
    ) -> None:
        start_s = monotonic_s()
        self.pacer.start(self.world.t_us)
        with stop_signals() as stopped:
            while self.done < ticks and not stopped:
                packets = self._tick()
                if self.sinks.stop_wanted:
                    stopped.append("stopped")
                self.wall_seconds = monotonic_s() - start_s
                for observer in observers:
                    observer(self.done, self.world, packets)
                for line in self.statistics.new_warnings():
                    self._warn(line)
                if progress is not None:
                    sofar = sum(self.statistics.events.values())
                    where = (self.done, ticks, self.sim_seconds, sofar, self.wall_seconds)
                    progress(Progress(*where))
        if rest := self._finish():
            for observer in observers:
                observer(self.done, self.world, rest)
        if stopped and self.done < ticks:
            self.ended = f"{stopped[0]} at {self.sim_seconds:.6g} s"
        self.pace_monitor.end()

    def _tick(self) -> tuple[EventPacket, ...]:
        watch = self.watch
        watch.begin_tick()
        packets = self.world.step()
        watch.lap("pack")
        # a packet leaves when the wall clock reaches the end of its tick
        self.pacer.wait_until(self.world.t_us)
        self.pace_monitor.update()
        watch.skip()
        if pace := self.pace_monitor.pace_update(self.world.t_us):
            self.sinks.write_pace(pace)
        self.sinks.write_auxiliary(self.world.cameras, self.world.t_us)
        self._write(packets)
        watch.lap("sink")
        watch.end_tick()
        self.statistics.count_tick()
        return packets

    def _finish(self) -> tuple[EventPacket, ...]:
        """The packets that would have left with later ones."""
        packets = self.world.finish()
        self._write(packets)
        return packets

    def _write(self, packets: tuple[EventPacket, ...]) -> None:
        self.sinks.write(packets)
        self.statistics.count_packets(packets)

    def _warn(self, line: str) -> None:
        self.warnings.append(line)
        if self.warn is not None:
            self.warn(line)

    def close(self) -> BaseException | None:
        """Close every sink that was opened, the last first; the first error, if any.

        What the cameras still hold back is written before, however the run ended.
        """
        first: BaseException | None = None
        try:
            if self.began:
                self._finish()
        except BaseException as error:  # whatever it is, the sinks must be closed
            first = error
        closing = self.sinks.close()
        return first or closing
