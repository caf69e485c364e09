"""The whole sweep: every point on every scene under every camera motion, errors and speeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from evs.drivers.cores import cores
from evs.drivers.run.report import versions
from evs.emulator.world import digest_of
from evs.msgs import EvsError, unknown
from evs.tools.doctor.machine import cpu_name
from evs.tools.evaluation.cache import LightCache
from evs.tools.evaluation.digest import digest
from evs.tools.evaluation.scene_setup import Stage
from evs.tools.evaluation.scenes import stage_of
from evs.tools.evaluation.take import MOTIONS
from evs.tools.jobs import run_jobs
from evs.tools.jobs.worker_pool import MOST_WORKERS
from evs.tools.sweep.errors import ErrorSettings, Judge
from evs.tools.sweep.jobs import ErrorsJob
from evs.tools.sweep.listener import BusListener
from evs.tools.sweep.measured import FRAMES, Error, Measured, Speed
from evs.tools.sweep.points import Point, shaping
from evs.tools.sweep.speed import SpeedSettings, Timer
from evs.tools.sweep.store import SHAPING, Header, Store
from evs.tools.sweep.usable import usable
from evs.tools.sweep.yardstick import WORDS, Yardstick

ERRORS, SPEEDS = "errors", "speeds"

QUICK_ERRORS = ErrorSettings(pixels=256, ticks=100, reference_spp=128)
QUICK_SPEEDS = SpeedSettings(seconds=0.3)


@dataclass(frozen=True)
class Settings:
    """What is swept, and how. Raises EvsError for values without sense."""

    scenes: tuple[str, ...]
    cameras: tuple[str, ...]
    points: tuple[Point, ...]
    errors: ErrorSettings = dataclasses.field(default_factory=ErrorSettings)
    speeds: SpeedSettings = dataclasses.field(default_factory=SpeedSettings)
    what: tuple[str, ...] = (ERRORS, SPEEDS)
    workers: int = 1
    """processes that work out errors at once; speeds are measured by this one, alone"""
    ray: str = ""
    """address of a Ray cluster that works out errors instead"""

    def __post_init__(self) -> None:
        for what, names in (("scene", self.scenes), ("camera", self.cameras)):
            if not names:
                raise EvsError(f"no {what} is asked for; give at least one")
            if len(set(names)) < len(names):
                raise EvsError(f"a {what} stands twice in {', '.join(names)}; give each once")
        for name in self.cameras:
            if name not in MOTIONS:
                raise unknown("camera motion", name, MOTIONS)
        if not 1 <= self.workers <= MOST_WORKERS:
            raise EvsError(f"{self.workers} workers cannot be: give 1 ... {MOST_WORKERS}")

    @property
    def comparable(self) -> dict[str, Any]:
        """What all records of one file have in common."""
        return dataclasses.asdict(self.errors) | dataclasses.asdict(self.speeds)


@dataclass(frozen=True)
class Case:
    """One scene under one camera motion."""

    scene: str
    camera: str
    stage: Stage

    def digest(self, point: Point) -> str:
        """Of everything that shapes what a point gives there."""
        told = dataclasses.replace(self.stage, name="", model=None)
        way = point.value if point.kind == FRAMES else ""
        return digest((_model(self.stage), told, self.camera, shaping(point.config), way))

    def record(self, point: Point) -> Measured:
        """Of the point, nothing measured yet."""
        return Measured(
            self.scene,
            self.camera,
            point.preset,
            point.axis,
            point.value,
            dict(point.settings),
            point.kind,
            digest=self.digest(point),
        )


def _model(stage: Stage) -> str:
    return _model_digest(id(stage.model), stage)


@lru_cache(maxsize=64)
def _model_digest(_identity: int, stage: Stage) -> str:
    return digest_of(stage.model)


def cases_of(settings: Settings) -> list[Case]:
    """Every scene under every camera motion. Raises EvsError: a scene that is not there."""
    stages = {scene: stage_of(scene) for scene in settings.scenes}
    return [
        Case(scene, camera, stage) for scene, stage in stages.items() for camera in settings.cameras
    ]


Moved = Callable[[int, str], None]
"""(points done so far, what is being done)"""


@dataclass
class Sweep:
    """Measures what a store does not have yet."""

    settings: Settings
    cases: Sequence[Case]
    store: Store
    cache: LightCache
    about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """of the header, as it is here and now"""
    moved: Moved = lambda _done, _what: None
    warn: Callable[[str], None] = lambda _line: None
    done: int = 0
    failed: int = 0
    """points that could not be measured on some scene"""

    def run(self) -> None:
        """All of it. Ctrl-C keeps what is whole. Raises EvsError."""
        points, cases = usable(self.settings.points, self.warn), self.cases
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
        """How far `moved` goes."""
        told = self.settings
        return len(told.scenes) * len(told.cameras) * len(told.points) * len(told.what)

    def _errors(self, case: Case, points: Sequence[Point]) -> None:
        judge = Judge(case.stage, case.camera, self.settings.errors, self.cache)
        for point, record in self._missing(case, points, ERRORS):
            try:
                found = judge.error(point)
            except EvsError as error:
                self._left_out(record, error)
            else:
                self.store.add(dataclasses.replace(record, error=found))

    def _errors_apart(self, cases: Sequence[Case], points: Sequence[Point]) -> None:
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

        def take(job: ErrorsJob, _is_new: bool) -> None:
            for record, found in zip(wanted[job.name], job.read(target), strict=True):
                if isinstance(found, Error):
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
            on_done=take,
            on_lost=self.warn,
        )

    def _speeds(
        self, case: Case, points: Sequence[Point], yardstick: Yardstick, address: str
    ) -> None:
        timer = Timer(
            case.stage, case.camera, self.settings.speeds, yardstick, address,
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
                    speed = known[record.digest] = timer.speed(point)
                except EvsError as error:
                    self._left_out(record, error)
                    continue
            self.store.add(dataclasses.replace(record, speed=speed))

    def _missing(
        self, case: Case, points: Sequence[Point], what: str
    ) -> Iterator[tuple[Point, Measured]]:
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

    def _left_out(self, record: Measured, error: EvsError) -> None:
        self.failed += 1
        self.warn(f"{record.scene}, {record.camera}: {record.label} is left out: {error}")


def header(settings: Settings, command: str) -> Header:
    """The first line of a sweep's file, on this machine."""
    about = {
        "command": command,
        "machine": f"{cpu_name()}, {cores()} cores",
        "versions": versions(),
        "yardstick": WORDS,
        "reference": (
            f"events of {settings.errors.reference_spp} samples a pixel every ms on "
            f"{settings.errors.pixels} pixels"
        ),
    }
    return Header(settings.comparable, about)


def own_store(folder: Path, settings: Settings) -> Path:
    """Where a sweep is kept that is told no file: one of its own for each kind of settings."""
    told = {name: versions().get(name) for name in SHAPING}
    return folder / f"{digest((settings.comparable, told))[:12]}.jsonl"
