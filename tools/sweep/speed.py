"""SpeedMeter: time the whole run of a point, bus and recorder on, as in `evs emulate`.

One run is cut into repeats of as many ticks. Between two of them, in time that belongs to neither,
the yardstick is measured.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evs.drivers.clock import StopWatch, monotonic_s, process_cpu_s
from evs.drivers.run.config import PipelineConfig, SinkConfig, make_sink
from evs.drivers.run.open_loop import depth_of
from evs.drivers.run.report import COMPLETE, STAGES
from evs.drivers.run.run import run
from evs.drivers.sink import Sink
from evs.msgs import EvsError
from evs.tools.evaluation.scene_setup import SceneSetup
from evs.tools.sweep.confidence import confidence_interval
from evs.tools.sweep.errors import size_of
from evs.tools.sweep.frame_methods import frame_method
from evs.tools.sweep.points import SweepPoint
from evs.tools.sweep.record import FRAMES, Speed
from evs.tools.sweep.segmented_world import SegmentedWorld
from evs.tools.sweep.sweep_world import SweepWorld
from evs.tools.sweep.yardstick import Yardstick

SLOW_REPEATS = 3
"""of points whose repeats take much longer than they should"""
MOST_SIM_S = 0.5
"""simulated time of all repeats together: fast points need not see another part of the scene"""
SUBSCRIBER_S = 20.0
_SLOW = 2.0
"""times as long as they should: repeats are fewer then"""
STILL = "still"
_LOOKS = 4
"""ticks after the first that say how long one takes"""


@dataclass(frozen=True)
class SpeedSettings:
    """How long and how often.

    Raises:
        EvsError: a value is out of range.
    """

    seconds: float = 0.6
    """wall clock of all repeats of a point together"""
    repeats: int = 6
    """from 6 on, the interval needs no law of the noise"""

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds <= 3600.0:
            raise EvsError(f"seconds is {self.seconds:g}; give more than 0 ... 3600")
        if not 1 <= self.repeats <= 1000:
            raise EvsError(f"repeats is {self.repeats}; give 1 ... 1000")


@dataclass
class TimedRepeat:
    """What one of them took."""

    ticks: int
    wall_s: float
    cpu_s: float
    yardstick_s: float
    """mean of before and after"""
    stage_ms: dict[str, float]


class CutWatch(StopWatch):
    """A stopwatch that sums up each stage from cut to cut.

    Sums, because a chunk's work is all done in its last tick: no tick is like the median one.
    """

    def __init__(self) -> None:
        super().__init__()
        self._sums_s: dict[str, float] = {}

    def lap(self, stage: str) -> None:
        """As of StopWatch."""
        before_s = self.so_far_s(stage)
        super().lap(stage)
        taken_s = self.so_far_s(stage) - before_s
        self._sums_s[stage] = self._sums_s.get(stage, 0.0) + taken_s

    def cut(self) -> dict[str, float]:
        """Seconds of each stage since the last cut."""
        taken, self._sums_s = self._sums_s, {}
        return taken


@dataclass
class _Cutter:
    """An observer of the run: ends a repeat after every `ticks` and begins the next."""

    ticks: int
    watch: CutWatch
    yardstick: Yardstick
    repeats: list[TimedRepeat] = field(default_factory=list)
    traced: float = 0.0
    seen: int = 0

    def begin(self) -> None:
        """The first repeat begins with the next tick."""
        self.before_s = self.yardstick.measure_s()
        self.watch.cut()
        self.cpu_s, self.begin_s = process_cpu_s(), monotonic_s()

    def __call__(self, done: int, world: Any, _packets: object) -> None:
        """After each tick."""
        if self.seen == done:
            # the rest of a chunk, behind the last tick
            return
        self.seen = done
        self.traced += world.cameras[0].traced_fraction
        if done % self.ticks:
            return
        wall_s, cpu_s = monotonic_s() - self.begin_s, process_cpu_s() - self.cpu_s
        stage_ms = {name: 1e3 * s / self.ticks for name, s in self.watch.cut().items()}
        after_s = self.yardstick.measure_s()
        mean_s = 0.5 * (self.before_s + after_s)
        self.repeats.append(TimedRepeat(self.ticks, wall_s, cpu_s, mean_s, stage_ms))
        self.before_s = after_s
        self.cpu_s, self.begin_s = process_cpu_s(), monotonic_s()


@dataclass(frozen=True)
class SpeedMeter:
    """Times points on one scene under one camera motion."""

    setup: SceneSetup
    motion: str
    settings: SpeedSettings
    yardstick: Yardstick
    address: str
    """where the listener waits for the bus"""
    seed: int = 0

    def speed(self, point: SweepPoint) -> Speed:
        """Its speed.

        Raises:
            EvsError: it cannot run.
            KeyboardInterrupt: after Ctrl-C.
        """
        config = point.config
        method = frame_method(point.value) if point.kind == FRAMES else None
        watch = CutWatch()
        world = SweepWorld(self.setup, self.motion, config, self.seed, method, watch)
        chunk = world.cameras[0].chunk
        tick_s = _tick_s(world, chunk, self.motion != STILL, self.settings.seconds)
        ticks, repeats = self._length(tick_s, chunk, config.scene.tick_us)
        cutter = _Cutter(ticks, watch, self.yardstick)
        with tempfile.TemporaryDirectory() as folder:
            file = SinkConfig(type="aedat4", file=str(Path(folder) / "run.aedat4"))
            bus = SinkConfig(type="zmq", address=self.address, wait_for=1, wait_s=SUBSCRIBER_S)
            begin = _AtOpening(cutter.begin)
            with closing(SegmentedWorld(world, ticks, watch, depth_of(config))) as running:
                report = run(
                    running,
                    # the last one opened: what the others take for that is not counted
                    [make_sink(bus), make_sink(file), begin],
                    1e-6 * config.scene.tick_us * ticks * repeats,
                    watch,
                    observers=[cutter],
                )
        if report.ended != COMPLETE:
            raise KeyboardInterrupt
        return speed_of(cutter.repeats, config, cutter.traced / (ticks * repeats))

    def _length(self, tick_s: float, chunk: int, tick_us: int) -> tuple[int, int]:
        """(ticks of a repeat, repeats) for ticks that take so long."""
        settings = self.settings
        repeats = settings.repeats
        if repeats * chunk * tick_s > _SLOW * settings.seconds:
            repeats = min(repeats, SLOW_REPEATS)
        most = min(settings.seconds / tick_s, MOST_SIM_S * 1e6 / tick_us)
        chunks = max(1, int(most / (repeats * chunk)))
        return chunks * chunk, repeats


def _tick_s(world: SweepWorld, chunk: int, moving: bool, enough_s: float) -> float:
    """How long a tick takes, roughly; afterwards the world is warm and its chunk is empty.

    In: moving, every tick traces the whole picture, as the first light does.
    """
    begin_s = monotonic_s()
    world.step()
    first_s = monotonic_s() - begin_s
    if chunk == 1 and moving and first_s > _SLOW * enough_s:
        # the first light and a tick: one more would say nothing new
        return 0.5 * first_s
    for _ in range(chunk - 1):
        world.step()
    looks = 1 if first_s > enough_s else _LOOKS
    ticks = -(-looks // chunk) * chunk
    begin_s = monotonic_s()
    for _ in range(ticks):
        world.step()
    return max(1e-6, (monotonic_s() - begin_s) / ticks)


class _AtOpening(Sink):
    """A sink that takes nothing: it says when the run begins."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call = call

    def open(self, streams: object) -> None:  # noqa: ARG002
        """Now."""
        self._call()

    def write(self, packet: object) -> None:
        """Nothing."""

    def close(self) -> dict[str, Any]:
        """Nothing."""
        return {}


def speed_of(repeats: list[TimedRepeat], config: PipelineConfig, traced: float) -> Speed:
    """The intervals of all repeats.

    Args:
        repeats: the timed repeats.
        config: of the pipeline.
        traced: share of the pixels, mean of all ticks.
    """
    tick_s = 1e-6 * config.scene.tick_us
    width, height = size_of(config.sensor)
    stages = {
        name: confidence_interval([one.stage_ms.get(name, 0.0) for one in repeats])
        for name in STAGES
    }
    return Speed(
        real_time_factor=confidence_interval([one.ticks * tick_s / one.wall_s for one in repeats]),
        cpu_s_per_s=confidence_interval([one.cpu_s / (one.ticks * tick_s) for one in repeats]),
        yardstick_ratio=confidence_interval(
            [one.wall_s / one.ticks / one.yardstick_s for one in repeats]
        ),
        stage_ms=stages,
        rays_per_tick=traced * width * height * config.render.samples,
        ticks=repeats[0].ticks,
    )
