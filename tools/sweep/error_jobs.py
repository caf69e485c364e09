"""ErrorsJob: the errors of all points of one scene and camera motion, as a job."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

from evs.emulator.world import digest_of
from evs.msgs import EvsError
from evs.tools.evaluation.digest import digest
from evs.tools.evaluation.light_cache import LightCache
from evs.tools.evaluation.scenes import scene_setup
from evs.tools.jobs import job_threads, report_progress
from evs.tools.sweep.errors import ErrorMeter, ErrorSettings
from evs.tools.sweep.points import SweepPoint, shaping
from evs.tools.sweep.record import Accuracy, finite, number


@dataclass(frozen=True)
class ErrorsJob:
    """Writes one file with a line for each point: its error, or why there is none."""

    scene: str
    camera: str
    points: tuple[SweepPoint, ...]
    settings: ErrorSettings
    cache: str
    """folder of the light"""

    @property
    def name(self) -> str:
        """Name of the file: a hash of all inputs."""
        configs = [(shaping(point.config), point.kind, point.value) for point in self.points]
        model = digest_of(scene_setup(self.scene).model)
        parts = (self.scene, model, self.camera, configs, dataclasses.asdict(self.settings))
        return f"{digest(parts)}.jsonl"

    def make(self, folder: Path) -> None:
        """Measure the errors."""
        error_meter = ErrorMeter(
            scene_setup(self.scene), self.camera, self.settings, LightCache(Path(self.cache)),
            job_threads(),
        )  # fmt: skip
        lines = []
        for done, point in enumerate(self.points):
            report_progress(done / len(self.points))
            try:
                found = dataclasses.asdict(error_meter.error(point))
            except EvsError as error:
                lines.append(json.dumps({"left_out": str(error)}))
            else:
                lines.append(json.dumps(finite(found)))
        (folder / self.name).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")

    def read(self, target: Path) -> list[Accuracy | str]:
        """Read the file that `make` wrote: errors, or why there is none."""
        found: list[Accuracy | str] = []
        for line in (target / self.name).read_text(encoding="utf-8").splitlines():
            data = json.loads(line)
            if "left_out" in data:
                found.append(str(data["left_out"]))
            else:
                found.append(Accuracy(**{k: number(v, k) for k, v in data.items()}))
        return found
