"""Sensor presets: TOML files of config/sensors, or the user's own file of the same form."""

from __future__ import annotations

import tomllib
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from evs.emulator.config import SensorConfig
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import EvsError, unknown

# config/ lies beside emulator/, in the wheel as in the checkout; links are not followed
_PRESETS = Path(__file__).absolute().parents[2] / "config" / "sensors"
_KEYS = tuple(field.name for field in fields(SensorParameters) if field.name != "name")
_REQUIRED = tuple(
    field.name
    for field in fields(SensorParameters)
    if field.default is MISSING and field.name != "name"
)


def preset_names() -> list[str]:
    """Names of the presets that come with evs, in alphabetical order."""
    return sorted(path.stem for path in _PRESETS.glob("*.toml"))


def resolve_sensor(config: SensorConfig) -> SensorParameters:
    """The sensor of a configuration: its preset, with every key that the configuration gives.

    `config.preset` is the name of a preset or the path of a .toml file (it ends in .toml or has a
    slash in it). Raises EvsError: no such preset or file, unknown or missing key, senseless value.
    """
    path = _preset_path(config.preset)
    values = _read(path)
    for key in _KEYS:
        given = getattr(config, key)
        if given is not None:
            values[key] = given
    missing = [key for key in _REQUIRED if key not in values]
    if missing:
        raise EvsError(
            f"sensor file {path} lacks {', '.join(missing)}; add it, or sensor.{missing[0]}="
        )
    return SensorParameters(name=path.stem, **values)


def _preset_path(preset: str) -> Path:
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
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as reason:
        raise EvsError(f"sensor file {path} is not TOML: {str(reason).splitlines()[0]}") from None
    except OSError as reason:
        raise EvsError(f"cannot read sensor file {path}: {reason.strerror}") from None
    for key in values:
        if key not in _KEYS:
            raise unknown(f"key of sensor file {path}", key, _KEYS)
    return values
