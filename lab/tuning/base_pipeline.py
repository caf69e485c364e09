"""BasePipeline: the scene and pipeline to tune, and the keys that the user fixed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from evs.drivers.run import config as pipeline
from evs.drivers.run.config import PRESETS, PipelineConfig, pipelines
from evs.emulator.config import decoding
from evs.emulator.world import load_model
from evs.msgs import EvsError, unknown
from evs_lab.evaluation.scenes import FOLDERS, VIEWS, SceneSetup
from evs_lab.sweep.record import Setting
from evs_lab.tuning.space import NAMES

OWN = (*NAMES.values(), "model.chunk")
"""keys that tuning sets"""


@dataclass(frozen=True)
class BasePipeline:
    """A pipeline to tune."""

    config: PipelineConfig
    pinned: Mapping[str, Setting]
    """keys that the command line sets; tuning does not change them"""

    def with_settings(self, chosen: Mapping[str, Setting]) -> PipelineConfig:
        """The pipeline with these keys, except pinned ones."""
        keys = [(k, decoding.to_text(v)) for k, v in chosen.items() if k not in self.pinned]
        return decoding.override(self.config, keys)

    def setup(self) -> SceneSetup:
        """Its scene, for evaluation.

        Raises:
            EvsError: it cannot be loaded.
        """
        scene = self.config.scene
        return SceneSetup(
            scene.file,
            load_model(scene.file),
            self.config.camera,
            scene.camera,
            keyframe=scene.keyframe,
            bounces=self.config.render.bounces,
            flicker=self.config.render.flicker,
            sky=self.config.render.sky,
        )


def base_pipeline(name: str | None, keys: Sequence[tuple[str, str]] = ()) -> BasePipeline:
    """The pipeline of a command line.

    Args:
        name: an MJCF or MJB file, package:path, a robot of `evs evaluate` (gymnasium/ant), or a
            pipeline that has a scene.
        keys: of the pipeline and their texts.

    Raises:
        EvsError: no scene, or a pipeline that cannot be tuned.
    """
    if name is None:
        raise EvsError("no scene: give one, as in evs tune robot.xml --rtf 1.0")
    file, keys = None, list(keys)
    if Path(name).suffix == ".toml" or name in pipelines():
        file = name
        if name in PRESETS and "scene.file" not in dict(keys):
            raise EvsError(f"no scene: {name} needs one beside it, as in scene.file=robot.xml")
    elif name.isidentifier() and not Path(name).exists():
        raise EvsError(f"{unknown('pipeline', name, pipelines())}; a scene ends in .xml")
    else:
        keys = [*(_robot(name) or [("scene.file", name)]), *keys]
    config = pipeline.load(file, keys)
    if config.is_closed:
        raise EvsError('only an open loop is tuned; leave pace = "lockstep" and realtime.serve out')
    pinned = {key: _value(config, key) for key, _ in keys if key in OWN}
    return BasePipeline(config, {key: value for key, value in pinned.items() if value is not None})


def _robot(name: str) -> list[tuple[str, str]] | None:
    """The keys of a robot of another package, with the view of `evs evaluate`."""
    package, slash, robot = name.partition("/")
    if not slash or package not in FOLDERS or Path(name).exists() or Path(name).suffix:
        return None
    if name not in VIEWS:
        raise unknown("robot", name, VIEWS)
    x, y, z, distance = VIEWS[name]
    return [
        ("scene.file", f"{package}:{FOLDERS[package]}/{robot}.xml"),
        ("camera.lookat", f"{x:g},{y:g},{z:g}"),
        ("camera.distance", f"{distance:g}"),
        ("camera.azimuth", "90"),
        ("camera.elevation", "-20"),
    ]


def _value(config: PipelineConfig, key: str) -> Setting | None:
    """Value of a dotted key."""
    table: object = config
    for part in key.split("."):
        table = getattr(table, part)
    assert table is None or isinstance(table, str | int | float | bool)
    return table
