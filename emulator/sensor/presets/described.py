"""A sensor for people: every parameter with its value and where that comes from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, is_dataclass
from typing import Any

from evs.emulator.config import SensorConfig
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.presets.biases import effective
from evs.emulator.sensor.presets.resolve import preset_biases, preset_path, resolve_sensor
from evs.emulator.sensor.presets.sources import Sources, read_sources

DEFAULT = "default of evs: the file does not give it"


@dataclass(frozen=True)
class Parameter:
    """One parameter of a sensor."""

    key: str
    """dotted, without `sensor.`"""
    value: Any
    preset: Any
    """what it is with nominal biases and nothing given"""
    source: str
    """where the preset's value comes from"""


@dataclass(frozen=True)
class Bias:
    """One bias of a sensor."""

    key: str
    value: int
    nominal: int
    lowest: int
    highest: int
    source: str
    """where the nominal value comes from"""


@dataclass(frozen=True)
class Description:
    """Everything about a sensor."""

    name: str
    about: str
    parameters: tuple[Parameter, ...]
    biases: tuple[Bias, ...]


def describe_sensor(config: SensorConfig) -> Description:
    """The sensor of a configuration, resolved. Raises EvsError as resolve_sensor does."""
    now = dict(flat(resolve_sensor(config)))
    preset = dict(flat(resolve_sensor(SensorConfig(config.preset))))
    comments = read_sources(preset_path(config.preset))
    name = now.pop("name")
    tables = {key.rpartition(".")[0] for key in comments.of}
    parameters = tuple(
        Parameter(key, value, preset.get(key), comments.of.get(key, "") or DEFAULT)
        for key, value in now.items()
        # the sensor lacks what a table stands for that neither file nor configuration has
        if not key.rpartition(".")[0] or key.rpartition(".")[0] in tables or value != preset[key]
    )
    biases = tuple(_biases(config, comments))
    return Description(str(name), comments.about, parameters, biases)


def _biases(config: SensorConfig, comments: Sources) -> Iterator[Bias]:
    nominal = preset_biases(config.preset)
    if nominal is None:
        return
    given = {key: value for key, value in asdict(config.biases).items() if value is not None}
    now = effective(nominal, given)
    for key, value in nominal.values.items():
        ends = nominal.law.ranges[key]
        yield Bias(key, now[key], value, *ends, comments.of.get(f"biases.{key}", ""))


def flat(parameters: SensorParameters) -> Iterator[tuple[str, Any]]:
    """(dotted key, value) of every parameter, tables inside included; an absent table has none."""
    yield from _flat(parameters, "")


def _flat(table: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    for field in fields(table):
        value = getattr(table, field.name)
        if is_dataclass(value):
            yield from _flat(value, f"{prefix}{field.name}.")
        elif value is not None:
            yield f"{prefix}{field.name}", value
