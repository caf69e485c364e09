"""Randomised sensors: another sensor in every episode, drawn from ranges of its parameters.

A range is a text, for any numeric key of [sensor], dotted for the tables inside it:

    pos_thres = "uniform(0.15, 0.35)"             every value equally likely; whole keys: both ends
    cutoff_hz = "log_uniform(50, 500)"            the logarithm equally likely
    sigma_thres = "normal(0.03, 0.01)"            mean, standard deviation; without far outliers
    readout.scan_us = "choice(100, 200)"          one of these
    leak_rate_hz = "uniform(0.5, 2) * nominal"    times the value that the sensor has without ranges
    neg_thres = "normal(1, 0.1) * pos_thres"      times another key of the same episode

sensor/ranges.py has the distributions, and what a draw follows from.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import combinations
from typing import Any, TypeVar

from evs.emulator.config import SensorConfig
from evs.emulator.config.declaration import declaration
from evs.emulator.config.decoding import plain_config, plain_integer, plain_number
from evs.emulator.sensor.bias_laws import effective
from evs.emulator.sensor.presets import flat, preset_biases, resolve_sensor
from evs.emulator.sensor.ranges import (
    TERM,
    Key,
    Number,
    Range,
    Ranges,
    bound_ranges,
    draw_values,
)
from evs.msgs import EvsError, nearest_first, unknown

__all__ = [
    "TERM",
    "DrawnSensor",
    "Key",
    "Number",
    "Ranges",
    "SensorRanges",
    "keys_of",
    "nominal_values",
    "randomise_sensor",
    "sensor_with_values",
]

FIXED = ("width", "height")
"""the image has one size in all episodes"""

C = TypeVar("C")


@dataclass(frozen=True)
class DrawnSensor:
    """The sensor of one episode."""

    config: SensorConfig
    """the sensor with the values"""
    values: dict[str, Number]
    """key -> the value that was drawn"""
    seed: int
    episode: int

    @property
    def record(self) -> dict[str, Any]:
        """Where it comes from and what was drawn, for headers and reports."""
        return {"seed": self.seed, "episode": self.episode, "values": dict(self.values)}


class SensorRanges:
    """Validated ranges of a sensor's parameters; `draw` returns the sensor of an episode.

        ranges = SensorRanges({"pos_thres": "uniform(0.15, 0.35)"}, "davis346")
        camera = evs.EventCamera(model, sensor=ranges.draw(seed=1, episode=0).config)

    Equal arguments give equal sensors, in any process and on any machine.
    """

    def __init__(self, ranges: Ranges, sensor: str | SensorConfig = "davis346") -> None:
        """Check the ranges.

        Args:
            ranges: Key of [sensor] -> its range, as described above.
            sensor: Name of a preset, or a configuration, for all other values.

        Raises:
            EvsError: No such key or distribution, a range beyond the limits of its key, or values
                that no sensor can have.
        """
        if not isinstance(sensor, str | SensorConfig):
            raise EvsError(f"sensor= takes a name or a SensorConfig, not {sensor!r}")
        if not isinstance(ranges, Mapping):
            raise EvsError(
                f"randomise is {ranges!r}; give {{key of [sensor]: 'uniform(0.15, 0.35)', ...}}"
            )
        config = SensorConfig(preset=sensor) if isinstance(sensor, str) else sensor
        self.sensor = plain_config(config, "sensor")
        self.ranges = dict(ranges)
        """key -> its text, as given"""
        self._resolved = resolve_sensor(self.sensor)
        self._has_biases = any(value is not None for value in vars(self.sensor.biases).values())
        nominal = nominal_values(self.sensor)
        keys = keys_of(self.sensor)
        parsed = {
            name: Range.parse(_known_key(name, keys), text, keys, f"randomise.{name}")
            for name, text in self.ranges.items()
        }
        self._parts = bound_ranges(parsed, nominal)
        self._check_sensors()

    def draw(self, seed: int, episode: int = 0) -> DrawnSensor:
        """Draw the sensor of an episode.

        Args:
            seed: Any whole number, modulo 2^64.
            episode: Number of the episode, 0 ... 2^63 - 1.

        Raises:
            EvsError: Seed or episode is out of range.
        """
        values = draw_values(self._parts, seed, episode)
        made = sensor_with_values(self.sensor, values)
        return DrawnSensor(made, values, int(seed), int(episode))

    def _check_sensors(self) -> None:
        """Resolve the sensors at the ends of the ranges: of one, of any two, and of all."""
        ends = {part.key.name: part.ends for part in self._parts}
        for name, values in ends.items():
            for value in values:
                self._check({name: value}, name)
        for two in combinations(ends, 2):
            for places in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
                corner = {name: ends[name][at] for name, at in zip(two, places, strict=True)}
                self._check(corner, ", ".join(two))
        if len(ends) > 2:
            for place in (0, -1):
                self._check({name: values[place] for name, values in ends.items()}, ", ".join(ends))

    def _check(self, values: dict[str, Number], where: str) -> None:
        try:
            if self._has_biases or any(name.startswith("biases.") for name in values):
                made = resolve_sensor(sensor_with_values(self.sensor, values))
            else:
                # the same without the sensor's file, which takes longer than all else
                made = _replaced(self._resolved, values)
            if made.aps.enabled:
                made.aps.check_time(made.height)
        except EvsError as error:
            shown = ", ".join(f"{name} = {value:g}" for name, value in values.items())
            raise EvsError(f"at randomise ({where}): {error} (with {shown})") from None


def randomise_sensor(
    sensor: str | SensorConfig, ranges: Ranges, *, seed: int = 0, episode: int = 0
) -> SensorConfig:
    """The sensor of an episode, drawn from ranges: a pure function.

        sensor = evs.randomise_sensor("davis346", {"pos_thres": "uniform(0.15, 0.35)"}, seed=7)

    Args:
        sensor: Name of a preset, or a configuration, for all other values.
        ranges: Key of [sensor], dotted inside its tables, such as readout.scan_us -> one of
            uniform(low, high), log_uniform(low, high), normal(mean, deviation) and
            choice(a, b, ...); a suffix `* nominal` or `* KEY` multiplies it, and + adds.
        seed: Any whole number.
        episode: Number of the episode, 0 or more.

    Returns:
        The sensor with a value for every key of `ranges`.

    Raises:
        EvsError: A key, a range or a number is invalid.
    """
    return SensorRanges(ranges, sensor).draw(seed, episode).config


def sensor_with_values(sensor: str | SensorConfig, values: Mapping[str, Number]) -> SensorConfig:
    """A sensor with values by dotted key, as in the record of a randomised sensor.

    Args:
        sensor: Name of a preset, or a configuration.
        values: Key of [sensor], such as pos_thres or readout.scan_us -> value.

    Raises:
        EvsError: There is no such numeric key, or a value is not a number.
    """
    config = SensorConfig(preset=sensor) if isinstance(sensor, str) else sensor
    if not isinstance(values, Mapping):
        raise EvsError(f"the values are {values!r}; give {{'pos_thres': 0.2, ...}}")
    checked: dict[str, Number] = {}
    for name, value in values.items():
        if name not in _numeric_keys():
            raise unknown("numeric key of [sensor]", str(name), _numeric_keys())
        plain = plain_integer if _numeric_keys()[name].whole else plain_number
        checked[name] = plain(value, f"sensor.{name}")
    return _replaced(config, checked)


def _replaced(sensor: C, values: Mapping[str, Number]) -> C:
    """A SensorConfig or SensorParameters with some values, by dotted key."""
    tables: dict[str, dict[str, Number]] = {}
    for name, value in values.items():
        table, _, key = name.rpartition(".")
        tables.setdefault(table, {})[key] = value
    own: dict[str, Any] = dict(tables.pop("", {}))
    for table, inside in tables.items():
        own[table] = replace(getattr(sensor, table), **inside)
    made: C = replace(sensor, **own)  # type: ignore[type-var]
    return made


def keys_of(sensor: SensorConfig) -> dict[str, Key]:
    """Every key of [sensor] that may have a range, by its dotted name."""
    biases = preset_biases(sensor.preset)
    ranges = biases.law.ranges if biases else {}
    found = {}
    for name, key in _numeric_keys().items():
        table, _, bias = name.partition(".")
        if table == "biases":
            # a sensor has the biases of its own chip
            if bias in ranges:
                low, high = ranges[bias]
                found[name] = replace(key, within=(float(low), float(high)))
        elif name not in FIXED:
            found[name] = key
    return found


def _known_key(name: str, keys: Mapping[str, Key]) -> Key:
    """The key of [sensor] of this name. EvsError: it is none that may have a range."""
    if name in FIXED:
        raise EvsError(
            f"at randomise.{name}: the image has one size in all episodes; set sensor.{name}"
        )
    if name not in keys:
        name = str(name)
        what = "no numeric key of [sensor]"
        if name in _numeric_keys():
            what = "this sensor has no such bias"
        nearest = nearest_first(name, keys)[0]
        raise EvsError(f"at randomise.{name}: {what}; nearest known: {nearest}")
    return keys[name]


def nominal_values(sensor: SensorConfig) -> dict[str, Number]:
    """The value of every numeric key without ranges, by its dotted name."""
    values = dict(flat(resolve_sensor(sensor)))
    if biases := preset_biases(sensor.preset):
        given = {key: value for key, value in asdict(sensor.biases).items() if value is not None}
        values |= {f"biases.{key}": value for key, value in effective(biases, given).items()}
    return {name: values[name] for name in _numeric_keys() if name in values}


@cache
def _numeric_keys() -> dict[str, Key]:
    return dict(_keys(SensorConfig, ""))


def _keys(table: type[Any], prefix: str) -> Iterator[tuple[str, Key]]:
    hints = typing.get_type_hints(table)
    for field in fields(table):
        kinds = set(typing.get_args(hints[field.name])) - {type(None)}
        if is_dataclass(hint := hints[field.name]) and isinstance(hint, type):
            yield from _keys(hint, f"{prefix}{field.name}.")
        elif kinds in ({int}, {float}):
            declared = declaration(field)
            within = declared.within if declared else None
            name = prefix + field.name
            yield name, Key(name, kinds == {int}, within or (-math.inf, math.inf))
