"""RunLoop: ticks of a world into sinks, and however the run ends every sink is closed.

There is one such loop. What moves the world is a subclass's: a duration (drivers/run/run.py), or
controllers elsewhere (drivers/lockstep/serve.py).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from evs.drivers.clock import Pacer, StopWatch
from evs.drivers.run.pace_monitor import PaceMonitor
from evs.drivers.run.report import COMPLETE, Report
from evs.drivers.run.sensor_control import SensorControl
from evs.drivers.run.sink_set import AuxiliaryStreams
from evs.drivers.run.statistics import RunStatistics, RunWorld
from evs.msgs import EventPacket, Pace


class TickSinks(Protocol):
    """What a run writes its ticks to; SinkSet and the segments of a closed loop are."""

    @property
    def stop_wanted(self) -> bool:
        """Whether a client of a sink requested the end of the run."""

    @property
    def reports(self) -> list[dict[str, Any]]:
        """What each sink reported when it was closed."""

    def write_tick(
        self,
        cameras: Sequence[AuxiliaryStreams],
        packets: Sequence[EventPacket],
        t_us: int,
        pace: Pace | None = None,
    ) -> None:
        """Write everything of the tick that ended at t_us."""

    def close(self) -> BaseException | None:
        """Close every sink that was opened; the first error, if any."""


class RunLoop(ABC):
    """One run: its ticks, its statistics, its warnings, its end, its report."""

    def __init__(
        self,
        world: RunWorld,
        sinks: TickSinks,
        watch: StopWatch,
        pacer: Pacer,
        warn: Callable[[str], None] | None,
        sensors: SensorControl | None = None,
    ) -> None:
        """Make a run that has not begun.

        Args:
            world: What the ticks are of.
            sinks: Where they go, not open yet.
            watch: The meter that the world laps.
            pacer: What a tick waits for before its packets leave.
            warn: Gets a line for each thing that is legal but hardly meant.
            sensors: What clients of the sinks change; None: nothing.
        """
        self.world, self.watch, self.pacer = world, watch, pacer
        self._sinks, self._warn = sinks, warn
        self.pace_monitor = PaceMonitor(pacer, self.warn)
        self.statistics = RunStatistics(world, watch)
        self._sensors = sensors
        self.warnings = list(world.left_out)
        self.ended = COMPLETE
        self.began = False
        self.wall_seconds = 0.0

    @property
    @abstractmethod
    def sim_seconds(self) -> float:
        """Simulated seconds so far."""

    @abstractmethod
    def start(self) -> None:
        """Open everything; the run has begun when this returns."""

    @abstractmethod
    def drive(self) -> None:
        """Move the world until the run is over; sets `ended` where it stopped early."""

    @abstractmethod
    def stop(self) -> None:
        """End what `start` began, before the sinks are closed."""

    def describe(self) -> dict[str, Any]:
        """Return the report's part on the loop itself."""
        return {}

    def warn(self, line: str) -> None:
        """Pass a warning on and keep it for the report."""
        self.warnings.append(line)
        if self._warn is not None:
            self._warn(line)

    def run(
        self,
        begun: Callable[[], None] | None,
        on_report: Callable[[Report], None] | None,
        config: Mapping[str, Any] | None,
    ) -> Report:
        """Run to the end.

        Args:
            begun: Called once everything is open, before the first tick.
            on_report: Gets the report once, after all sinks are closed, however the run ends; a run
                whose sinks did not open never began.
            config: Stands in the report.

        Returns:
            The report.

        Raises:
            EvsError: From physics or a sink, like any other error, after every sink was closed.
        """
        failure: BaseException | None = None
        try:
            self.start()
            self.began = True
            if begun is not None:
                begun()
            self.drive()
        except KeyboardInterrupt:
            self.ended = f"interrupted at {self.sim_seconds:.6g} s"
        except BaseException as error:
            self.ended = f"error at {self.sim_seconds:.6g} s: {error or type(error).__name__}"
            failure = error
        closing = self._close()
        if isinstance(closing, KeyboardInterrupt):
            self.ended = f"interrupted at {self.sim_seconds:.6g} s, while closing"
        elif closing is not None and failure is None:
            self.ended, failure = f"error while closing: {closing}", closing
        try:
            report = self.statistics.report(
                ended=self.ended,
                sim_seconds=self.sim_seconds,
                wall_seconds=self.wall_seconds,
                sinks=self._sinks.reports,
                pace=self.pacer.report(),
                warnings=list(dict.fromkeys([*self.warnings, *self.world.left_out])),
                config=dict(config or {}),
                loop=self.describe(),
                sensor_changes=self._sensors.changes if self._sensors else (),
            )
            if on_report is not None and self.began:
                on_report(report)
        except MemoryError:
            # what ended the run matters more than its report
            if failure is None:
                raise
            self.warn("no memory is left for the run report")
            raise failure from failure.__cause__
        if failure is not None:
            raise failure
        return report

    def deliver(self, packets: tuple[EventPacket, ...]) -> None:
        """Write what the tick that the world has just made brought, once its time has come."""
        watch, world = self.watch, self.world
        watch.lap("pack")
        # a packet leaves when the wall clock reaches the end of its tick
        self.pacer.wait_until(world.t_us)
        self.pace_monitor.update()
        watch.skip()
        pace = self.pace_monitor.pace_update(world.t_us)
        self._sinks.write_tick(world.cameras, packets, world.t_us, pace)
        self.statistics.count_packets(packets)
        watch.lap("sink")
        watch.end_tick()
        self.statistics.count_tick()

    def _close(self) -> BaseException | None:
        """Stop and close every sink that was opened; the first error, if any."""
        first: BaseException | None = None
        try:
            if self.began:
                self.stop()
        except BaseException as error:  # whatever it is, the sinks must be closed
            first = error
        closing = self._sinks.close()
        return first or closing
