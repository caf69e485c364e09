"""Points of a sweep: a preset with some of its keys changed, and whose method it uses."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from evs.drivers.run.config import PipelineConfig, find_pipeline
from evs.emulator.camera.pixel_pipeline import check_chunk
from evs.emulator.config import decoding
from evs.emulator.render.renderer_factory import check_render
from evs.emulator.render.renderer_table import SEEDS
from evs.msgs import EvsError
from evs_lab.sweep.record import OURS, Setting

SHAPING = ("seed", "threads", "ahead", "scene", "camera", "sensor", "render", "model", "plan")
"""tables and keys of a pipeline that a point may change: what shapes events or their cost"""


@dataclass(frozen=True)
class SweepPoint:
    """One configuration, on no scene yet."""

    preset: str
    axis: str = ""
    """what is varied; empty: the preset itself"""
    value: str = ""
    """in words"""
    settings: tuple[tuple[str, Setting], ...] = ()
    """keys that differ from the preset's, by name"""
    kind: str = OURS

    @property
    def config(self) -> PipelineConfig:
        """The whole configuration.

        Raises:
            EvsError: an invalid key or value.
        """
        return _config_of(self.preset, self.settings)


@lru_cache(maxsize=1024)
def _config_of(preset: str, changes: tuple[tuple[str, Setting], ...]) -> PipelineConfig:
    return configured(preset_of(preset), dict(changes))


@lru_cache(maxsize=32)
def preset_of(name: str) -> PipelineConfig:
    """The pipeline of a preset: one that comes with evs, or a file.

    Its scene and sinks are unused.

    Raises:
        EvsError: no such pipeline, or an invalid key or value in it.
    """
    path = find_pipeline(name)
    try:
        config = decoding.build(PipelineConfig, decoding.read_toml(path))
        check(config)
    except EvsError as error:
        raise EvsError(f"preset '{name}' ({path}): {error}") from None
    return config


def configured(base: PipelineConfig, changes: Mapping[str, Setting]) -> PipelineConfig:
    """The pipeline with these keys set. Raises EvsError."""
    for key in changes:
        if key.partition(".")[0] not in SHAPING:
            raise EvsError(f"at {key}: a sweep changes only keys of {', '.join(SHAPING)}")
    texts = [(key, decoding.to_text(value)) for key, value in changes.items()]
    base = decoding.override(base, texts)
    check(base)
    return base


def check(config: PipelineConfig) -> None:
    """Refuse what renderer and model would refuse, before anything is measured. EvsError."""
    seeds = SEEDS.get(config.render.renderer, ())
    if seeds and config.render.seeds not in seeds:
        raise EvsError(
            f"render.seeds is {config.render.seeds}, but {config.render.renderer} has only "
            f"{', '.join(seeds)}"
        )
    check_render(config.render)
    check_chunk(config.model)


def differences(base: PipelineConfig, other: PipelineConfig) -> dict[str, Setting]:
    """The keys of `other` that differ, by their dotted names, with its values."""
    before, after = (_flat(decoding.to_plain(config)) for config in (base, other))
    return {key: value for key, value in after.items() if before.get(key) != value}


def sweep_point(
    preset: str, axis: str, value: str, changes: Mapping[str, Setting], kind: str = OURS
) -> SweepPoint:
    """The point, without settings that the preset has anyway. Raises EvsError."""
    base = preset_of(preset)
    changed = differences(base, configured(base, changes))
    return SweepPoint(preset, axis, value, tuple(sorted(changed.items())), kind)


def unique(points: Iterable[SweepPoint]) -> list[SweepPoint]:
    """Drop the points of an axis that are the same as their preset."""
    return [one for one in points if not one.axis or one.settings or one.kind != OURS]


def _flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in tables.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{key}.")
        else:
            found[prefix + key] = value
    return found


def shaping(config: PipelineConfig) -> dict[str, Any]:
    """Everything of a configuration that can shape events or speed, in plain values."""
    plain: dict[str, Any] = decoding.to_plain(dataclasses.replace(config, duration_s=1.0))
    return {name: plain[name] for name in SHAPING}
