"""Sensor presets: TOML files of config/sensors, or the user's own file of the same form."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from evs.emulator.base.small_files import read_small_text
from evs.emulator.config import SensorConfig
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.presets.biases import Nominal, nominal_biases, with_biases
from evs.emulator.sensor.presets.tables import SensorFile, fill
from evs.msgs import EvsError, unknown

# config/ lies beside emulator/, in the wheel as in the checkout; links are not followed
_PRESETS = Path(__file__).absolute().parents[3] / "config" / "sensors"


def preset_names() -> list[str]:
    """Names of the presets that come with evs, in alphabetical order."""
    return sorted(path.stem for path in _PRESETS.glob("*.toml"))


def resolve_sensor(config: SensorConfig) -> SensorParameters:
    """Resolve a sensor: its preset, with every key that the configuration gives.

    Nested tables are merged in the same way, key by key. Biases other than the preset's change its
    parameters, except those that the configuration gives.

    Args:
        config: [sensor]; `preset` is the name of a preset or the path of a .toml file (it ends in
            .toml or has a slash in it).

    Raises:
        EvsError: No such preset or file, an unknown or missing key, a senseless value.
    """
    path = preset_path(config.preset)
    values = _read(path)
    given = {key: value for key, value in asdict(config.biases).items() if value is not None}
    fixed = [field.name for field in fields(config) if getattr(config, field.name) is not None]
    nominal = _nominal(values, path)
    values = with_biases(values, nominal, given, fixed, path.stem)
    try:
        return fill(SensorParameters, SensorFile(path, values), config, name=path.stem)
    except EvsError as error:
        if given:  # a value that nobody gave would puzzle
            raise EvsError(f"{error} (sensor.biases has changed the preset)") from None
        raise


def preset_biases(preset: str) -> Nominal | None:
    """The biases of a preset, with their nominal values and laws; None: it has none."""
    path = preset_path(preset)
    return _nominal(_read(path), path)


def completed(config: dict[str, Any], sensor: SensorParameters) -> dict[str, Any]:
    """Complete a [sensor] table with every number that the sensor really has.

    Args:
        config: Plain values, where None stands for the preset's. A key of the table [biases] stays
            None where the bias is the preset's.
        sensor: The sensor, resolved; its parameters are those that the biases made.
    """
    return _completed(config, asdict(sensor))


def _completed(config: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    complete = dict(config)
    for key, value in values.items():
        if isinstance(value, dict) and isinstance(complete.get(key), dict):
            complete[key] = _completed(complete[key], value)
        elif key in complete and complete[key] is None:
            complete[key] = value
    return complete


def _nominal(values: dict[str, Any], path: Path) -> Nominal | None:
    """Take the table [biases] out of a sensor file's values."""
    table = values.pop("biases", None)
    if table is None:
        return None
    if not isinstance(table, dict):
        raise EvsError(f"sensor file {path}: biases is {table!r}; make it a table [biases]")
    return nominal_biases(table, str(path))


def preset_path(preset: str) -> Path:
    """The file of a preset, by name or path. Raises EvsError where there is none."""
    if preset.endswith(".toml") or "/" in preset:
        path = Path(preset).expanduser()
        if not path.is_file():
            presets = ", ".join(preset_names())
            raise EvsError(f"no sensor file {path}; give a .toml file or one of: {presets}")
        return path
    names = preset_names()
    if preset not in names:
        raise unknown("sensor", preset, names)
    return _PRESETS / f"{preset}.toml"


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_small_text(path))
    except (ValueError, RecursionError) as reason:
        raise EvsError(f"sensor file {path} is not TOML: {str(reason).splitlines()[0]}") from None
    except OSError as reason:
        raise EvsError(f"cannot read sensor file {path}: {reason.strerror}") from None
