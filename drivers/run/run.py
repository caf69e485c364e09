"""A run of a given duration, in an open loop: the world steps by itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from evs.drivers.clock import Pacer, StopWatch, monotonic_s
from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.report import Progress, Report
from evs.drivers.run.run_loop import RunLoop
from evs.drivers.run.sensor_control import SensorControl
from evs.drivers.run.sink_set import SinkSet
from evs.drivers.run.statistics import RunWorld
from evs.drivers.run.stop_signals import stop_signals
from evs.drivers.sink import Sink
from evs.emulator.base.memory_limits import cores
from evs.msgs import EventPacket, EvsError

MAX_SECONDS = 1e9
"""Longer than 30 years is a mistake, not a run."""


Observer = Callable[[int, Any, tuple[EventPacket, ...]], None]
"""Called after every tick with (tick from 1, world, packets); its time belongs to no stage."""


def tick_count(duration_s: float, tick_us: int) -> int:
    """Return the whole ticks nearest to a duration. Raises EvsError for none or too many."""
    if tick_us < 1:
        raise EvsError(f"at scene.tick_us: {tick_us} is not a valid tick; give 1 us or more")
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
    """Run a world for a duration, in whole ticks.

    Ctrl-C and SIGTERM end the run after the current tick: the report's `ended` says so.

    Args:
        world: Stepped once a tick.
        sinks: Not open yet.
        duration_s: Simulated time.
        meter: The one that the world laps.
        pace: What a tick waits for before its packets leave; free if None.
        progress: Called after every tick.
        observers: Called after every tick.
        begun: Called once all sinks are open, before the first tick.
        warn: Gets a line for each thing that is legal but hardly meant.
        on_report: Gets the report exactly once, after all sinks are closed, however the run ends; a
            run whose sinks did not open never began.
        config: Stands in the report.

    Returns:
        The report.

    Raises:
        EvsError: From physics or a sink, like any other error, after every sink was closed: what
            was recorded until then is complete.
    """
    watch, pacer = meter or StopWatch(), pace or Pacer()
    loop = _TimedRun(world, sinks, duration_s, watch, pacer, progress, observers, warn)
    return loop.run(begun, on_report, config)


class _TimedRun(RunLoop):
    """Steps the world until its ticks are done or a request to stop."""

    def __init__(
        self,
        world: RunWorld,
        sinks: Sequence[Sink],
        duration_s: float,
        watch: StopWatch,
        pacer: Pacer,
        progress: Callable[[Progress], None] | None,
        observers: Sequence[Observer],
        warn: Callable[[str], None] | None,
    ) -> None:
        sensors = SensorControl(world)
        self._sink_set = SinkSet(sinks, watch, self.warn, sensors)
        super().__init__(world, self._sink_set, watch, pacer, warn, sensors)
        self._duration_s, self._progress, self._observers = duration_s, progress, observers
        self._begin_us = world.t_us
        self._ticks = 0

    @property
    def sim_seconds(self) -> float:
        """Simulated seconds so far."""
        return (self.world.t_us - self._begin_us) / 1e6

    def start(self) -> None:
        """Open the sinks. EvsError where the duration is no number of ticks."""
        infos = [camera.info for camera in self.world.cameras]
        self._ticks = tick_count(self._duration_s, infos[0].tick_us if infos else 1000)
        self._sink_set.open(infos)

    def drive(self) -> None:
        """Step, tick by tick."""
        start_s = monotonic_s()
        self.pacer.start(self.world.t_us)
        with stop_signals() as stopped:
            while self.statistics.ticks < self._ticks and not stopped:
                self.watch.begin_tick()
                packets = self.world.step()
                self.deliver(packets)
                if self._sink_set.stop_wanted:
                    stopped.append("stopped")
                self.wall_seconds = monotonic_s() - start_s
                self._observe(packets)
        if rest := self._flush():
            for observer in self._observers:
                observer(self.statistics.ticks, self.world, rest)
        if stopped and self.statistics.ticks < self._ticks:
            self.ended = f"{stopped[0]} at {self.sim_seconds:.6g} s"
        self.pace_monitor.end()

    def stop(self) -> None:
        """Write what the cameras still hold back, however the run ended."""
        self._flush()

    def _observe(self, packets: tuple[EventPacket, ...]) -> None:
        """Call the observers and the progress, after a tick."""
        done = self.statistics.ticks
        for observer in self._observers:
            observer(done, self.world, packets)
        for line in self.statistics.new_warnings():
            self.warn(line)
        if self._progress is not None:
            sofar = sum(self.statistics.events.values())
            where = (done, self._ticks, self.sim_seconds, sofar, self.wall_seconds)
            self._progress(Progress(*where))

    def _flush(self) -> tuple[EventPacket, ...]:
        """Write the packets that would have left with later ones."""
        packets = self.world.finish()
        self._sink_set.write(packets)
        self.statistics.count_packets(packets)
        return packets


def depth_of(config: PipelineConfig) -> int:
    """Return how many ticks ahead light is computed: none with one thread, or on one core."""
    alone = config.threads == 1 or cores() == 1
    return 0 if alone else config.ahead
