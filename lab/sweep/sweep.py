"""The whole sweep: every point on every scene under every camera motion, errors and speeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from evs.drivers.run.report import versions
from evs.emulator import World
from evs.emulator.base.memory_limits import cores
from evs.emulator.base.package_paths import in_package
from evs.emulator.config import RenderConfig, SensorConfig
from evs.emulator.world import digest_of
from evs.msgs import EvsError, unknown
from evs.tools.doctor.machine import cpu_name
from evs.tools.jobs import run_jobs
from evs.tools.jobs.worker_pool import MOST_WORKERS
from evs_lab.evaluation.clip import MOTIONS
from evs_lab.evaluation.digest import digest
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.evaluation.scenes import SceneSetup, scene_setup
from evs_lab.sweep.bus_listener import BusListener
from evs_lab.sweep.errors import ErrorMeter, ErrorSettings, ErrorsJob
from evs_lab.sweep.pixels import check_tick
from evs_lab.sweep.points import SweepPoint, shaping
from evs_lab.sweep.record import FRAMES, Accuracy, Speed, SweepRecord
from evs_lab.sweep.speed import YARDSTICK, SpeedMeter, SpeedSettings, Yardstick
from evs_lab.sweep.store import SHAPING, SweepHeader, SweepStore

DEFAULT_SCENES = {
    "dm_control/humanoid": "primitives, one soft lamp; the project's headline",
    "gymnasium/ant": "primitives over a checker, one soft lamp",
    "evs:config/scenes/pencil.xml": "ours: bright, hard edges, a camera of the model",
    "procedural/1": "meshes, dark, three lamps of some size, three bounces",
    "procedural/4": "meshes, dark, an area light, three bounces",
    "procedural/8": "primitives and a mesh, bright, three lamps",
}
"""scene -> why it is included"""

QUICK_SCENES = ("dm_control/humanoid",)
"""scenes of `--quick`"""

_SCENE = "evs:config/scenes/pendulum.xml"


def feasible(points: Sequence[SweepPoint], warn: Callable[[str], None]) -> list[SweepPoint]:
    """Select the points that this machine can measure, before anything is measured.

    Args:
        points: of the sweep.
        warn: called with a line for the others, once for each reason.
    """
    found: list[SweepPoint] = []
    reported: set[str] = set()
    for point in points:
        reason = _infeasible_reason(point)
        if not reason:
            found.append(point)
        elif reason not in reported:
            reported.add(reason)
            warn(f"{point.preset}, {point.axis} {point.value} is left out: {reason}")
    return found


def _infeasible_reason(point: SweepPoint) -> str:
    """Why a point cannot be measured; empty: it can."""
    config = point.config
    try:
        check_tick(config.model, config.scene.tick_us)
        if config.render.renderer == "raster":
            _draw_once()
    except EvsError as error:
        return str(error)
    return ""


def _draw_once() -> None:
    """Draw one small picture with OpenGL. Raises EvsError without the extra or OpenGL."""
    small = SensorConfig(preset="ideal", width=16, height=12)
    view = World(in_package(_SCENE)).add_view(sensor=small, render=RenderConfig(renderer="raster"))
    view.render()


ERRORS, SPEEDS = "errors", "speeds"

QUICK_ERRORS = ErrorSettings(pixels=256, ticks=100, reference_spp=128)
QUICK_SPEEDS = SpeedSettings(seconds=0.3)


@dataclass(frozen=True)
class SweepSettings:
    """What is swept, and how.

    Raises:
        EvsError: a value is out of range.
    """

    scenes: tuple[str, ...]
    cameras: tuple[str, ...]
    points: tuple[SweepPoint, ...]
    errors: ErrorSettings = dataclasses.field(default_factory=ErrorSettings)
    speeds: SpeedSettings = dataclasses.field(default_factory=SpeedSettings)
    what: tuple[str, ...] = (ERRORS, SPEEDS)
    workers: int = 1
    """processes that compute errors in parallel; this one measures speeds, alone"""
    ray: str = ""
    """address of a Ray cluster that computes errors instead"""

    def __post_init__(self) -> None:
        for what, names in (("scene", self.scenes), ("camera", self.cameras)):
            if not names:
                raise EvsError(f"no {what} is given; give at least one")
            if len(set(names)) < len(names):
                raise EvsError(f"a {what} is given twice in {', '.join(names)}; give each once")
        for name in self.cameras:
            if name not in MOTIONS:
                raise unknown("camera motion", name, MOTIONS)
        if not 1 <= self.workers <= MOST_WORKERS:
            raise EvsError(f"workers is {self.workers}: give 1 ... {MOST_WORKERS}")

    @property
    def comparable(self) -> dict[str, Any]:
        """What all records of one file have in common."""
        return dataclasses.asdict(self.errors) | dataclasses.asdict(self.speeds)


@dataclass(frozen=True)
class SweepCase:
    """One scene under one camera motion."""

    scene: str
    camera: str
    setup: SceneSetup

    def digest(self, point: SweepPoint) -> str:
        """Hash of everything that shapes the result of a point."""
        parts = dataclasses.replace(self.setup, name="", model=None)
        method = point.value if point.kind == FRAMES else ""
        return digest((_model(self.setup), parts, self.camera, shaping(point.config), method))

    def record(self, point: SweepPoint) -> SweepRecord:
        """A record of the point without measurements."""
        return SweepRecord(
            self.scene,
            self.camera,
            point.preset,
            point.axis,
            point.value,
            dict(point.settings),
            point.kind,
            digest=self.digest(point),
        )


def _model(setup: SceneSetup) -> str:
    return _model_digest(id(setup.model), setup)


@lru_cache(maxsize=64)
def _model_digest(_identity: int, setup: SceneSetup) -> str:
    return digest_of(setup.model)


def sweep_cases(settings: SweepSettings) -> list[SweepCase]:
    """Every scene under every camera motion.

    Raises:
        EvsError: a scene that is not there.
    """
    setups = {scene: scene_setup(scene) for scene in settings.scenes}
    return [
        SweepCase(scene, camera, setup)
        for scene, setup in setups.items()
        for camera in settings.cameras
    ]


Moved = Callable[[int, str], None]
"""(points done so far, what is being done)"""


@dataclass
class Sweep:
    """Measures what a store does not have yet."""

    settings: SweepSettings
    cases: Sequence[SweepCase]
    store: SweepStore
    cache: LightCache
    about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """of the header, as it is here and now"""
    moved: Moved = lambda _done, _what: None
    warn: Callable[[str], None] = lambda _line: None
    done: int = 0
    failed: int = 0
    """points that could not be measured on some scene"""

    def run(self) -> None:
        """Measure all points. Ctrl-C keeps what is complete. Raises EvsError."""
        points, cases = feasible(self.settings.points, self.warn), self.cases
        if ERRORS in self.settings.what:
            if self.settings.workers > 1 or self.settings.ray:
                self._errors_apart(cases, points)
            else:
                for case in cases:
                    self._errors(case, points)
        if SPEEDS in self.settings.what:
            self.store.begin_timings(self.about)
            yardstick = Yardstick()
            with BusListener() as listener:
                for case in cases:
                    self._speeds(case, points, yardstick, listener.address)

    def total(self) -> int:
        """Number of points times measurements, the end of `moved`."""
        parts = self.settings
        return len(parts.scenes) * len(parts.cameras) * len(parts.points) * len(parts.what)

    def _errors(self, case: SweepCase, points: Sequence[SweepPoint]) -> None:
        error_meter = ErrorMeter(case.setup, case.camera, self.settings.errors, self.cache)
        for point, record in self._missing(case, points, ERRORS):
            try:
                found = error_meter.error(point)
            except EvsError as error:
                self._left_out(record, error)
            else:
                self.store.add(dataclasses.replace(record, error=found))

    def _errors_apart(self, cases: Sequence[SweepCase], points: Sequence[SweepPoint]) -> None:
        """In processes of the runner, or on its cluster, a case each."""
        jobs, wanted = [], {}
        for case in cases:
            missing = list(self._missing(case, points, ERRORS))
            if missing:
                job = ErrorsJob(
                    case.scene,
                    case.camera,
                    tuple(point for point, _ in missing),
                    self.settings.errors,
                    str(self.cache.folder),
                )
                jobs.append(job)
                wanted[job.name] = [record for _, record in missing]
        target = self.cache.folder / "errors"

        def store_errors(job: ErrorsJob, _is_new: bool) -> None:
            for record, found in zip(wanted[job.name], job.read(target), strict=True):
                if isinstance(found, Accuracy):
                    self.store.add(dataclasses.replace(record, error=found))
                else:
                    self._left_out(record, EvsError(found))
            # the store has it now; kept, it would outlive a change of evs
            (target / job.name).unlink()

        run_jobs(
            jobs,
            target,
            workers=self.settings.workers,
            ray=self.settings.ray,
            on_done=store_errors,
            on_lost=self.warn,
        )

    def _speeds(
        self, case: SweepCase, points: Sequence[SweepPoint], yardstick: Yardstick, address: str
    ) -> None:
        speed_meter = SpeedMeter(
            case.setup, case.camera, self.settings.speeds, yardstick, address,
            self.settings.errors.seed,
        )  # fmt: skip
        # the same configuration by two names is measured once
        known = {
            one.digest: one.speed
            for one in self.store.records
            if (one.scene, one.camera) == (case.scene, case.camera) and one.speed is not None
        }
        for point, record in self._missing(case, points, SPEEDS):
            speed: Speed | None = known.get(record.digest)
            if speed is None:
                try:
                    speed = known[record.digest] = speed_meter.speed(point)
                except EvsError as error:
                    self._left_out(record, error)
                    continue
            self.store.add(dataclasses.replace(record, speed=speed))

    def _missing(
        self, case: SweepCase, points: Sequence[SweepPoint], what: str
    ) -> Iterator[tuple[SweepPoint, SweepRecord]]:
        """Points that the store has no error, or speed, of."""
        there = {
            (one.point, one.digest)
            for one in self.store.records
            if (one.error if what == ERRORS else one.speed) is not None
        }
        for point in points:
            record = case.record(point)
            self.moved(self.done, f"{case.scene}, {case.camera}: {record.label}, {what}")
            if (record.point, record.digest) not in there:
                yield point, record
            self.done += 1
        self.moved(self.done, "")

    def _left_out(self, record: SweepRecord, error: EvsError) -> None:
        self.failed += 1
        self.warn(f"{record.scene}, {record.camera}: {record.label} is left out: {error}")


def header(settings: SweepSettings, command: str) -> SweepHeader:
    """The first line of a sweep's file, on this machine."""
    about = {
        "command": command,
        "machine": f"{cpu_name()}, {cores()} cores",
        "versions": versions(),
        "yardstick": YARDSTICK,
        "reference": (
            f"events of light with {settings.errors.reference_spp} samples per pixel, in ticks of "
            f"1 ms, for {settings.errors.pixels} pixels"
        ),
    }
    return SweepHeader(settings.comparable, about)


def default_store(folder: Path, settings: SweepSettings) -> Path:
    """The default file of a sweep: one for each kind of settings."""
    parts = {name: versions().get(name) for name in SHAPING}
    return folder / f"{digest((settings.comparable, parts))[:12]}.jsonl"
