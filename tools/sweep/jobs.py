"""Errors as jobs of the runner: all points of one scene under one camera motion."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

from evs.emulator.world import digest_of
from evs.msgs import EvsError
from evs.tools.evaluation.cache import LightCache
from evs.tools.evaluation.digest import digest
from evs.tools.evaluation.scenes import stage_of
from evs.tools.jobs import job_threads, report_progress
from evs.tools.sweep.errors import ErrorSettings, Judge
from evs.tools.sweep.measured import Error, finite, number
from evs.tools.sweep.points import Point, shaping


@dataclass(frozen=True)
class ErrorsJob:
    """Writes one file: a line a point, its error, or why there is none."""

    scene: str
    camera: str
    points: tuple[Point, ...]
    settings: ErrorSettings
    cache: str
    """folder of the light"""

    @property
    def name(self) -> str:
        """A file of its own for everything that its content follows from."""
        configs = [(shaping(point.config), point.kind, point.value) for point in self.points]
        model = digest_of(stage_of(self.scene).model)
        told = (self.scene, model, self.camera, configs, dataclasses.asdict(self.settings))
        return f"{digest(told)}.jsonl"

    def make(self, folder: Path) -> None:
        """Work them out. Raises EvsError."""
        judge = Judge(
            stage_of(self.scene), self.camera, self.settings, LightCache(Path(self.cache)),
            job_threads(),
        )  # fmt: skip
        lines = []
        for done, point in enumerate(self.points):
            report_progress(done / len(self.points))
            try:
                found = dataclasses.asdict(judge.error(point))
            except EvsError as error:
                lines.append(json.dumps({"left_out": str(error)}))
            else:
                lines.append(json.dumps(finite(found)))
        (folder / self.name).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")

    def read(self, target: Path) -> list[Error | str]:
        """What `make` wrote and the runner brought to `target`: errors, or why there is none."""
        found: list[Error | str] = []
        for line in (target / self.name).read_text(encoding="utf-8").splitlines():
            told = json.loads(line)
            if "left_out" in told:
                found.append(str(told["left_out"]))
            else:
                found.append(Error(**{k: number(v, k) for k, v in told.items()}))
        return found
