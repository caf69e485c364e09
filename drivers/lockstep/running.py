"""A run in lock-step: the loop of a pipeline, its sinks, its server, its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy.typing as npt

from evs.drivers.clock import Pacer, StopWatch, monotonic_s
from evs.drivers.lockstep.realtime import RealtimeServer
from evs.drivers.lockstep.segments import Segments
from evs.drivers.lockstep.server import LockstepServer
from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.pace_config import PACES
from evs.drivers.run.pace_monitor import PaceMonitor
from evs.drivers.run.report import COMPLETE, Report
from evs.drivers.run.statistics import RunStatistics, Totals
from evs.drivers.run.stop_signals import stop_signals
from evs.emulator import Loop, World
from evs.emulator.base.protocols import Meter
from evs.msgs import EventPacket, EvsError, Observation, StreamInfo
from evs.msgs.lockstep.common import F64

_STEP_ENDS_S = 1.0
"""A step that has taken longer does not keep a server from ending."""


def loop_of(config: PipelineConfig, meter: Meter | None = None) -> Loop:
    """The closed loop that a pipeline describes."""
    plain = config.emulation()
    if not config.lockstep.cameras:
        world = World.from_config(plain, meter=meter)
    else:
        if plain.scene.camera:
            raise EvsError(
                f"at scene.camera: '{plain.scene.camera}' beside lockstep.cameras; give it there"
            )
        world = World(plain.scene, seed=plain.seed, threads=plain.threads, meter=meter)
        for camera in config.lockstep.cameras:
            world.add_camera(camera, sensor=plain.sensor, render=plain.render, model=plain.model)
    return Loop.around(world, **config.loop.options())


def serve(
    config: PipelineConfig,
    *,
    make_loop: Callable[[Meter], Loop] | None = None,
    meter: StopWatch | None = None,
    warn: Callable[[str], None] | None = None,
    begun: Callable[[Sequence[str]], None] | None = None,
    ready: Callable[[str], None] | None = None,
    on_report: Callable[[Report], None] | None = None,
    said_config: Mapping[str, Any] | None = None,
) -> tuple[Report, list[str]]:
    """Serve until Ctrl-C, SIGTERM or a `stop` at a control port; the report, the files recorded.

    In: make_loop, where the loop is another than the pipeline's; begun is called with World.chosen
    and ready with the address once controllers may connect; said_config stands in the report;
    the others as of pipeline.run.
    Raises EvsError as that does.
    """
    watch = meter or StopWatch()
    warnings: list[str] = []

    def tell(line: str) -> None:
        warnings.append(line)
        if warn is not None:
            warn(line)

    loop = make_loop(watch) if make_loop is not None else loop_of(config, watch)
    warnings += loop.world.left_out
    pacer = Pacer(PACES.get(config.pace, 0.0), catch_up_s=config.realtime.catch_up_s)
    segments = Segments(config.sinks(), watch, tell, config.beside)
    beside = LoopWithSinks(loop, segments, watch, pacer, tell)
    keys = config.lockstep
    server = (RealtimeServer if config.realtime.serve else LockstepServer)(
        beside,
        keys.address,
        controllers=keys.controllers,
        timeout_s=keys.timeout_s,
        key=keys.key,
        allow=keys.allow,
        insecure=keys.insecure,
        warn=tell,
    )
    ended = COMPLETE
    failure: BaseException | None = None
    begin_s, began = monotonic_s(), False
    try:
        # sinks first: whoever connects may step at once
        beside.segments.open(loop.streams)
        server.open()
        began = True
        if begun is not None:
            begun(loop.world.chosen)
        if ready is not None:
            ready(server.address)
        begin_s = monotonic_s()
        with stop_signals() as stopped:
            beside.stopped = stopped
            while not stopped and beside.failure is None and not beside.segments.stop_wanted:
                server.poll()
        failure = beside.failure
        beside.pace_monitor.end()
        ended = f"{stopped[0] if stopped else 'stopped'} at {beside.sim_seconds:.6g} s"
    except KeyboardInterrupt:
        ended = f"interrupted at {beside.sim_seconds:.6g} s"
    except BaseException as error:
        failure = error
    wall_s = monotonic_s() - begin_s
    if failure is not None:
        ended = f"error at {beside.sim_seconds:.6g} s: {failure or type(failure).__name__}"
    server.close()
    closing = beside.segments.close()
    if closing is not None and failure is None:
        ended, failure = f"error while closing: {closing}", closing
    report = beside.statistics.report(
        ended=ended,
        sim_seconds=beside.sim_seconds,
        wall_seconds=wall_s,
        sinks=beside.segments.reports,
        warnings=warnings,
        config=dict(said_config or {}),
        pace=pacer.report(),
        loop={**server.report(), **beside.lost(), "files": beside.segments.files},
    )
    if on_report is not None and began:
        on_report(report)
    if failure is not None:
        raise failure
    return report, beside.segments.files


class LoopWithSinks:
    """A served loop that hands every tick to sinks, undelayed, and keeps the account of it."""

    def __init__(
        self,
        loop: Loop,
        segments: Segments,
        watch: StopWatch,
        pacer: Pacer,
        warn: Callable[[str], None],
    ) -> None:
        """In: pacer, what a tick waits for before its packets leave."""
        self._pacer, self.pace_monitor = pacer, PaceMonitor(pacer, warn)
        self.segments, self.statistics = segments, RunStatistics(loop.world, watch)
        self.failure: EvsError | None = None
        """of a sink: the run has to end"""
        self.stopped: Sequence[str] = ()
        """holds something once the run has to end"""
        self._step_s, self._ticks_left = 0.0, 0
        self._loop, self._watch, self._warn = loop, watch, warn
        self._lost = Totals(
            lambda: {
                "packets_lost": sum(loop.dropped.values()),
                "events_lost": loop.events_dropped,
            }
        )
        loop.on_tick = self._take

    @property
    def sim_seconds(self) -> float:
        """Simulated seconds of all ticks."""
        return self.statistics.ticks * self._loop.tick_us / 1e6

    def reset(
        self, seed: int | None = None, keyframe: str = "", state: bool = False
    ) -> Observation:
        """As of the loop; recordings of an episode before it are complete then."""
        return self._jump(lambda: self._loop.reset(seed, keyframe, state))

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        """As of the loop."""
        self._step_s, self._ticks_left = monotonic_s(), ticks
        self._watch.begin_tick()
        return self._loop.step(ctrl, ticks)

    def save(self, compress: bool = False) -> bytes:
        """As of the loop."""
        return self._loop.save(compress)

    def restore(self, blob: bytes) -> Observation:
        """As of the loop; recordings of the time before it are complete then."""
        return self._jump(lambda: self._loop.restore(blob))

    def lost(self) -> dict[str, int]:
        """What the delay model lost, over all episodes."""
        return self._lost.now()

    @property
    def actuators(self) -> Sequence[str]:
        """As of the loop."""
        return self._loop.actuators

    @property
    def ctrl(self) -> F64:
        """As of the loop."""
        return self._loop.ctrl

    @property
    def ctrl_range(self) -> F64:
        """As of the loop."""
        return self._loop.ctrl_range

    @property
    def streams(self) -> Sequence[StreamInfo]:
        """As of the loop."""
        return self._loop.streams

    @property
    def tick_us(self) -> int:
        """As of the loop."""
        return self._loop.tick_us

    @property
    def t_us(self) -> int:
        """As of the loop."""
        return self._loop.t_us

    @property
    def done(self) -> str:
        """As of the loop."""
        return self._loop.done

    def _take(self, packets: tuple[EventPacket, ...]) -> None:
        """After a tick. What a sink cannot do is no refusal of the loop, which has moved."""
        watch, world = self._watch, self._loop.world
        watch.lap("pack")
        self._pacer.wait_until(world.t_us)
        self.pace_monitor.update()
        watch.skip()
        if self.failure is None:
            try:
                pace = self.pace_monitor.pace_update(world.t_us)
                self.segments.write(world.cameras, packets, world.t_us, pace)
            except EvsError as error:
                self.failure = error
        self.statistics.count_packets(packets)
        self.statistics.count_tick()
        for line in self.statistics.new_warnings():
            self._warn(line)
        watch.lap("sink")
        watch.end_tick()
        # the step's next tick, if it has one
        watch.begin_tick()
        self._ticks_left -= 1
        if self.stopped and self._ticks_left > 0 and monotonic_s() - self._step_s > _STEP_ENDS_S:
            raise EvsError("the server of the loop has ended")

    def _jump(self, move: Callable[[], Observation]) -> Observation:
        """Do what may set time back; what it refuses has changed nothing, here neither."""
        before, lost = self.statistics.totals.read(), self._lost.read()
        seen = move()
        self.statistics.totals.jumped(before)
        self._lost.jumped(lost)
        self._pacer.start(self._loop.t_us)
        try:
            self.segments.begin(self._loop.streams)
        except EvsError as error:
            self.failure = error
        return seen
