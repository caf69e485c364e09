"""File names in a pipeline: relative to its file."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from evs.emulator.base.package_paths import package_of
from evs.emulator.config import RunConfig

C = TypeVar("C")
R = TypeVar("R", bound=RunConfig)

Change = Callable[[str], str]


def with_paths(config: C, change: Change) -> C:
    """A copy of a PipelineConfig in which every file name was changed."""
    changed_config: C = _with_sink_paths(with_run_paths(_any(config), change), change)
    return changed_config


def with_run_paths(config: R, change: Change) -> R:
    """A copy of a RunConfig in which every file name was changed that the emulation reads."""
    # a preset is a name, but may be a file of the user's own
    preset = config.sensor.preset
    is_file = preset.endswith(".toml") or "/" in preset
    sensor = _changed(config.sensor, ["preset"] if is_file else [], change)
    readout = _changed(config.sensor.readout, ["mask_file"], change)
    network = config.model.network
    is_file = network.endswith(".onnx") or "/" in network
    return dataclasses.replace(
        config,
        scene=_changed(config.scene, ["file", "control_file"], change),
        camera=_changed(config.camera, ["trajectory"], change),
        sensor=dataclasses.replace(sensor, readout=readout),
        model=_changed(config.model, ["network"] if is_file else [], change),
    )


def _with_sink_paths(config: Any, change: Change) -> Any:
    """The same for everything that a PipelineConfig has beyond."""

    def with_keys(table: Any, key: str, allow: str) -> Any:
        # a public key that is written out is no path
        places = getattr(table, allow)
        kept = tuple(p if len(p) == 40 else change(p) for p in places or ()) or places
        return dataclasses.replace(_changed(table, [key], change), **{allow: kept})

    sinks = tuple(
        with_keys(_changed(sink, ["rrd", "mcap", "file"], change), "key", "allow")
        for sink in config.sink
    )
    config = _changed(config, ["record", "report"], change)
    config = with_keys(config, "publish_key", "publish_allow")
    served = with_keys(config.lockstep, "key", "allow")
    return dataclasses.replace(config, sink=sinks, lockstep=served)


def _changed(table: Any, keys: Sequence[str], change: Change) -> Any:
    given = {key: getattr(table, key) for key in keys}
    return dataclasses.replace(table, **{k: change(v) for k, v in given.items() if v})


def _any(config: Any) -> Any:
    return config


def beside(pipeline: Path, text: str) -> str:
    """A path of a pipeline file: relative to that file."""
    return text if package_of(text) or text[:1] == "~" else str(pipeline.parent / text)
