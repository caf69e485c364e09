"""A run that controllers drive: the loop of a pipeline, its sinks, its server, its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy.typing as npt

from evs.drivers.clock import Pacer, StopWatch, monotonic_s
from evs.drivers.lockstep.realtime import RealtimeServer
from evs.drivers.lockstep.segments import Segments
from evs.drivers.lockstep.server import LockstepServer
from evs.drivers.run.config import PACES, PipelineConfig
from evs.drivers.run.report import Report
from evs.drivers.run.run_loop import RunLoop
from evs.drivers.run.sensor_control import SensorControl
from evs.drivers.run.statistics import Totals
from evs.drivers.run.stop_signals import stop_signals
from evs.emulator import ClosedLoop, World
from evs.emulator.base.protocols import Meter
from evs.msgs import EventPacket, EvsError, Observation, StreamInfo
from evs.msgs.lockstep import F64

_STEP_ENDS_S = 1.0
"""A step that has taken longer does not keep a server from ending."""


def loop_of(config: PipelineConfig, meter: Meter | None = None) -> ClosedLoop:
    """The closed loop that a pipeline describes."""
    if not config.lockstep.cameras:
        world = World.from_config(config, meter=meter)
    else:
        if config.scene.camera:
            raise EvsError(
                f"at scene.camera: '{config.scene.camera}' beside lockstep.cameras; give it there"
            )
        world = World(config.scene, seed=config.seed, threads=config.threads, meter=meter)
        for camera in config.lockstep.cameras:
            world.add_camera(camera, sensor=config.sensor, render=config.render, model=config.model)
    return ClosedLoop.around(world, **config.loop.options())


def serve(
    config: PipelineConfig,
    *,
    make_loop: Callable[[Meter], ClosedLoop] | None = None,
    meter: StopWatch | None = None,
    warn: Callable[[str], None] | None = None,
    begun: Callable[[Sequence[str]], None] | None = None,
    ready: Callable[[str], None] | None = None,
    on_report: Callable[[Report], None] | None = None,
    report_config: Mapping[str, Any] | None = None,
) -> tuple[Report, list[str]]:
    """Serve until Ctrl-C, SIGTERM or a `stop` at a control port.

    Args:
        config: Of the pipeline, whose pace is lockstep or which serves in real time.
        make_loop: Makes the loop where it is another than the pipeline's.
        meter: The one that the loop's world laps.
        warn: Called with a line for each setting that is legal but unlikely to be intended.
        begun: Called with World.chosen once controllers may connect.
        ready: Called with the server's address after that.
        on_report: See `run.run`.
        report_config: The configuration that stands in the report.

    Returns:
        The report, and the files that were recorded.

    Raises:
        EvsError: As run.run does.
    """
    watch = meter or StopWatch()
    loop = make_loop(watch) if make_loop is not None else loop_of(config, watch)
    pacer = Pacer(PACES.get(config.pace, 0.0), catch_up_s=config.realtime.catch_up_s)
    sensors = SensorControl(loop.world)
    segments = Segments(config.sinks(), watch, lambda line: run.warn(line), config.beside, sensors)
    run = ServedRun(loop, segments, watch, pacer, warn, sensors)
    keys = config.lockstep
    run.server = (RealtimeServer if config.realtime.serve else LockstepServer)(
        run,
        keys.address,
        controllers=keys.controllers,
        timeout_s=keys.timeout_s,
        key=keys.key,
        allow=keys.allow,
        insecure=keys.insecure,
        warn=run.warn,
    )

    def announce() -> None:
        if begun is not None:
            begun(loop.world.chosen)
        if ready is not None:
            ready(run.server.address)

    report = run.run(announce, on_report, report_config)
    return report, segments.files


class ServedRun(RunLoop):
    """A run whose ticks controllers ask for; the loop that its server serves.

    Sinks get every tick undelayed. Where one of them fails the run ends, but a controller that has
    asked for the tick is not refused: the loop has moved.
    """

    server: LockstepServer

    def __init__(
        self,
        loop: ClosedLoop,
        segments: Segments,
        watch: StopWatch,
        pacer: Pacer,
        warn: Callable[[str], None] | None,
        sensors: SensorControl | None = None,
    ) -> None:
        """Make a run that has not begun; arguments as in RunLoop."""
        super().__init__(loop.world, segments, watch, pacer, warn, sensors)
        self.segments = segments
        self._stopped: Sequence[str] = ()
        self._step_s, self._ticks_left = 0.0, 0
        self._loop = loop
        self._lost = Totals(
            lambda: {
                "packets_lost": sum(loop.dropped.values()),
                "events_lost": loop.events_dropped,
            }
        )
        loop.on_tick = self._on_tick

    @property
    def sim_seconds(self) -> float:
        """Simulated seconds of all ticks, over all resets."""
        return self.statistics.ticks * self._loop.tick_us / 1e6

    def start(self) -> None:
        """Open the sinks, then the server: whoever connects may step at once."""
        self.segments.open(self._loop.streams)
        self.server.open()

    def drive(self) -> None:
        """Answer controllers until the run has to stop, or a sink fails."""
        begin_s = monotonic_s()
        try:
            with stop_signals() as stopped:
                self._stopped = stopped
                while (
                    not stopped and self.segments.failure is None and not self.segments.stop_wanted
                ):
                    self.server.poll()
            self.pace_monitor.end()
            self.ended = f"{stopped[0] if stopped else 'stopped'} at {self.sim_seconds:.6g} s"
            if self.segments.failure is not None:
                raise self.segments.failure
        finally:
            self.wall_seconds = monotonic_s() - begin_s

    def stop(self) -> None:
        """Release the server's port."""
        self.server.close()

    def describe(self) -> dict[str, Any]:
        """What the server did, what the delay model lost over all episodes, and the files."""
        return {**self.server.report(), **self._lost.now(), "files": self.segments.files}

    def reset(
        self, seed: int | None = None, keyframe: str = "", state: bool = False
    ) -> Observation:
        """Reset the loop once the recordings of the previous episode are complete."""
        return self._jump(lambda: self._loop.reset(seed, keyframe, state))

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        """See `ClosedLoop`."""
        self._step_s, self._ticks_left = monotonic_s(), ticks
        self.watch.begin_tick()
        return self._loop.step(ctrl, ticks)

    def save(self, compress: bool = False) -> bytes:
        """See `ClosedLoop`."""
        return self._loop.save(compress)

    def restore(self, blob: bytes) -> Observation:
        """Restore the loop once the recordings up to now are complete."""
        return self._jump(lambda: self._loop.restore(blob))

    @property
    def actuators(self) -> Sequence[str]:
        """See `ClosedLoop`."""
        return self._loop.actuators

    @property
    def ctrl(self) -> F64:
        """See `ClosedLoop`."""
        return self._loop.ctrl

    @property
    def ctrl_range(self) -> F64:
        """See `ClosedLoop`."""
        return self._loop.ctrl_range

    @property
    def streams(self) -> Sequence[StreamInfo]:
        """See `ClosedLoop`."""
        return self._loop.streams

    @property
    def tick_us(self) -> int:
        """See `ClosedLoop`."""
        return self._loop.tick_us

    @property
    def t_us(self) -> int:
        """See `ClosedLoop`."""
        return self._loop.t_us

    @property
    def done(self) -> str:
        """See `ClosedLoop`."""
        return self._loop.done

    def _on_tick(self, packets: tuple[EventPacket, ...]) -> None:
        self.deliver(packets)
        for line in self.statistics.new_warnings():
            self.warn(line)
        # the step's next tick, if it has one
        self.watch.begin_tick()
        self._ticks_left -= 1
        if self._stopped and self._ticks_left > 0 and monotonic_s() - self._step_s > _STEP_ENDS_S:
            raise EvsError("the server of the loop has ended")

    def _jump(self, move: Callable[[], Observation]) -> Observation:
        """Do what may set time back; what it refuses has changed nothing, here neither."""
        before, lost = self.statistics.totals.read(), self._lost.read()
        seen = move()
        self.statistics.totals.jumped(before)
        self._lost.jumped(lost)
        self.pacer.start(self._loop.t_us)
        self.segments.jump(self._loop.streams)
        return seen
