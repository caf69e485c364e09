"""File names in a pipeline: relative to its file, or inside an installed Python package."""

from __future__ import annotations

import dataclasses
import importlib.util
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from evs.msgs import EvsError

C = TypeVar("C")


def with_paths(config: C, change: Callable[[str], str]) -> C:
    """A copy of a PipelineConfig in which every file name was changed."""
    changed_config: C = _changed(config, change)
    return changed_config


def _changed(config: Any, change: Callable[[str], str]) -> Any:
    def changed(table: Any, keys: Sequence[str]) -> Any:
        given = {key: getattr(table, key) for key in keys}
        return dataclasses.replace(table, **{k: change(v) for k, v in given.items() if v})

    def with_keys(table: Any, key: str, allow: str) -> Any:
        # a public key that is written out is no path
        places = getattr(table, allow)
        kept = tuple(p if len(p) == 40 else change(p) for p in places or ()) or places
        return dataclasses.replace(changed(table, [key]), **{allow: kept})

    sinks = tuple(with_keys(changed(sink, ["rrd", "file"]), "key", "allow") for sink in config.sink)
    # a preset is a name, but may be a file of the user's own
    preset = config.sensor.preset
    is_file = preset.endswith(".toml") or "/" in preset
    sensor = changed(config.sensor, ["preset"] if is_file else [])
    readout = changed(config.sensor.readout, ["mask_file"])
    sensor = dataclasses.replace(sensor, readout=readout)
    scene = changed(config.scene, ["file", "control_file"])
    network = config.model.network
    is_file = network.endswith(".onnx") or "/" in network
    model = changed(config.model, ["network"] if is_file else [])
    config = with_keys(changed(config, ["record", "report"]), "publish_key", "publish_allow")
    served = with_keys(config.lockstep, "key", "allow")
    return dataclasses.replace(
        config, sink=sinks, scene=scene, sensor=sensor, model=model, lockstep=served
    )


def beside(pipeline: Path, text: str) -> str:
    """A path of a pipeline file: relative to that file."""
    return text if _package_of(text) or text[:1] == "~" else str(pipeline.parent / text)


def _package_of(text: str) -> re.Match[str] | None:
    # two letters or more, so that a drive letter is none; no slash after the colon, so no URL is
    return re.fullmatch(r"([A-Za-z_]\w+):([^/\\:].*)", text)


def in_package(text: str) -> str:
    """`package:path` as a path: a file that an installed Python package ships; `~` is the home."""
    found = _package_of(text)
    if found is None or Path(text).exists():
        return str(Path(text).expanduser()) if text[:1] == "~" else text
    spec = importlib.util.find_spec(found[1])
    folders = list(spec.submodule_search_locations or ()) if spec else []
    if not folders:
        raise EvsError(f"'{text}': no Python package '{found[1]}' here; pip install {found[1]}")
    return str(Path(folders[0]) / found[2])
