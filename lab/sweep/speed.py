"""Speed: time the whole run of a point, bus and recorder on, as in `evs emulate`.

One run is cut into repeats of as many ticks. Between two of them, in time that belongs to neither,
the yardstick is measured.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.clock import StopWatch, monotonic_s, process_cpu_s
from evs.drivers.run.config import PipelineConfig, make_sink
from evs.drivers.run.report import COMPLETE, STAGES
from evs.drivers.run.run import depth_of, run
from evs.drivers.sink import Sink
from evs.drivers.sink_config import Aedat4Sink, ZmqSink
from evs.msgs import EvsError
from evs_lab.evaluation.scenes import SceneSetup
from evs_lab.sweep.errors import size_of
from evs_lab.sweep.frame_methods import frame_method
from evs_lab.sweep.points import SweepPoint
from evs_lab.sweep.record import FRAMES, ConfidenceInterval, Speed
from evs_lab.sweep.sweep_world import SegmentedWorld, SweepWorld

YARDSTICK = (
    "logarithm, sort, sum of 346 x 260 floats in NumPy, 8 times on a thread, between repeats"
)

_YARDSTICK_SHAPE = 260, 346
_YARDSTICK_PASSES = 8
_YARDSTICK_RUNS = 3


class Yardstick:
    """A fixed piece of work, timed next to every repeat: the present speed of the machine.

    It is NumPy and nothing of ours, on one thread, so it stays the same when evs becomes faster.
    The time of a tick is reported as a ratio to it, which can be compared between machines and
    hours.
    """

    def __init__(self) -> None:
        drawn = np.random.Philox(key=7).random_raw(_YARDSTICK_SHAPE[0] * _YARDSTICK_SHAPE[1])
        self._numbers = (drawn.reshape(_YARDSTICK_SHAPE) / 2.0**64 + 0.5).astype(np.float32)
        self.measure_s()

    def measure_s(self) -> float:
        """Time the work, about 1 ms; the median of three, s."""
        return sorted(self._once_s() for _ in range(_YARDSTICK_RUNS))[_YARDSTICK_RUNS // 2]

    def _once_s(self) -> float:
        begin_s = monotonic_s()
        for _ in range(_YARDSTICK_PASSES):
            log = np.log(self._numbers)
            log.sort(axis=1)
            np.sum(log * log, dtype=np.float64)
        return monotonic_s() - begin_s


COVERAGE = 0.95

STUDENT = {2: 12.706, 3: 4.303, 4: 3.182, 5: 2.776}
"""repeats -> the 97.5 % quantile of Student's t with one degree of freedom less"""

_MAX_LOG = 100.0
"""largest half of an interval of logarithms, so that nothing overflows"""


def confidence_interval(values: Sequence[float]) -> ConfidenceInterval:
    """The median and its 95 % confidence interval.

    From six values on it uses order statistics, which assume no distribution: the median lies
    between the k-th smallest and the k-th largest of n with probability
    1 - 2 P(Binomial(n, 1/2) < k), and k is the largest that keeps 95 %. Fewer values cannot reach
    that. They use Student's t of their logarithms around the median's, since times differ by
    factors; with a zero among them, as of a stage that took no time, it is that of the values,
    clipped at zero. The interval of one value is NaN.
    """
    found = np.sort(np.asarray(values, np.float64))
    n, median = len(found), float(np.median(found))
    if n == 1:
        return ConfidenceInterval(median, math.nan, math.nan, 1)
    if n in STUDENT:
        share = STUDENT[n] / math.sqrt(n)
        if found[0] > 0.0:
            factor = math.exp(min(share * float(np.std(np.log(found), ddof=1)), _MAX_LOG))
            return ConfidenceInterval(median, median / factor, median * factor, n)
        half = share * float(np.std(found, ddof=1))
        return ConfidenceInterval(median, max(0.0, median - half), median + half, n)
    k = order(n)
    return ConfidenceInterval(median, float(found[k - 1]), float(found[n - k]), n)


def order(n: int) -> int:
    """The largest k whose interval, k-th smallest to k-th largest of n >= 6, keeps 95 %."""
    below = 1.0
    k = 0
    while 1.0 - 2.0 * below / 2.0**n >= COVERAGE:
        k += 1
        below += math.comb(n, k)
    return k


SLOW_REPEATS = 3
"""repeats of a point whose ticks are slow"""
MOST_SIM_S = 0.5
"""largest simulated time of all repeats: fast points see the same part of the scene as slow ones"""
SUBSCRIBER_S = 20.0
_SLOW = 2.0
"""a point is slow if its repeats take this many times as long as they should"""
STILL = "still"
_PROBE_TICKS = 4
"""ticks after the first that estimate the time of one"""


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
    """Times of one repeat."""

    ticks: int
    wall_s: float
    cpu_s: float
    yardstick_s: float
    """mean of before and after"""
    stage_ms: dict[str, float]


class CutWatch(StopWatch):
    """A stopwatch that sums each stage from cut to cut.

    It sums because all work of a chunk is done in its last tick: no tick is typical.
    """

    def __init__(self) -> None:
        super().__init__()
        self._sums_s: dict[str, float] = {}

    def lap(self, stage: str) -> None:
        """See `StopWatch`."""
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
        chunk = world.cameras[0].config.model.chunk
        samples = world.cameras[0].plan.view["samples"]
        tick_s = _tick_s(world, chunk, self.motion != STILL, self.settings.seconds)
        ticks, repeats = self._length(tick_s, chunk, config.scene.tick_us)
        cutter = _Cutter(ticks, watch, self.yardstick)
        with tempfile.TemporaryDirectory() as folder:
            file = Aedat4Sink(file=str(Path(folder) / "run.aedat4"))
            bus = ZmqSink(address=self.address, wait_for=1, wait_s=SUBSCRIBER_S)
            begin = _AtOpening(cutter.begin)
            with closing(SegmentedWorld(world, ticks, watch, depth_of(config))) as running:
                report = run(
                    running,
                    # opened last, so that the time to open the others is not counted
                    [make_sink(bus), make_sink(file), begin],
                    1e-6 * config.scene.tick_us * ticks * repeats,
                    watch,
                    observers=[cutter],
                )
        if report.ended != COMPLETE:
            raise KeyboardInterrupt
        return speed_of(cutter.repeats, config, samples * cutter.traced / (ticks * repeats))

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
    """Estimate the time of a tick, s; afterwards the world is warm and its chunk is empty.

    Args:
        world: the world that runs.
        chunk: ticks that its network takes at once.
        moving: whether every tick traces the full picture, as the first one does.
        enough_s: wall clock after which fewer ticks are measured.
    """
    begin_s = monotonic_s()
    world.step()
    first_s = monotonic_s() - begin_s
    if chunk == 1 and moving and first_s > _SLOW * enough_s:
        # the first light and a tick; another one would add no information
        return 0.5 * first_s
    for _ in range(chunk - 1):
        world.step()
    probes = 1 if first_s > enough_s else _PROBE_TICKS
    ticks = -(-probes // chunk) * chunk
    begin_s = monotonic_s()
    for _ in range(ticks):
        world.step()
    return max(1e-6, (monotonic_s() - begin_s) / ticks)


class _AtOpening(Sink):
    """A sink that stores nothing; it calls back when the run begins."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call = call

    def open(self, streams: object) -> None:  # noqa: ARG002
        """Call back."""
        self._call()

    def write(self, packet: object) -> None:
        """Nothing."""

    def close(self) -> dict[str, Any]:
        """Nothing."""
        return {}


def speed_of(repeats: list[TimedRepeat], config: PipelineConfig, rays: float) -> Speed:
    """The intervals of all repeats.

    Args:
        repeats: the timed repeats.
        config: of the pipeline.
        rays: of a pixel in a tick, mean of all.
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
        rays_per_tick=rays * width * height,
        ticks=repeats[0].ticks,
    )
