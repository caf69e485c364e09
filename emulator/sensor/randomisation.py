"""Randomised sensors: another sensor in every episode, drawn from ranges of its parameters.

A range is a text, for any numeric key of [sensor], dotted for the tables inside it:

    pos_thres = "uniform(0.15, 0.35)"             every value equally likely; whole keys: both ends
    cutoff_hz = "log_uniform(50, 500)"            the logarithm equally likely
    sigma_thres = "normal(0.03, 0.01)"            mean, standard deviation; without far outliers
    readout.scan_us = "choice(100, 200)"          one of these
    leak_rate_hz = "uniform(0.5, 2) * nominal"    times the value that the sensor has without ranges
    neg_thres = "normal(1, 0.1) * pos_thres"      times another key of the same episode

A draw is a pure function of sensor, range, seed, episode and the name of the key: it depends
neither on the order of the keys nor on the other ranges, and is the same on every machine. Values
have six significant digits, so that a record in decimals is the value that was used.
"""

from __future__ import annotations

import math
import re
import typing
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from decimal import Context, Decimal, localcontext
from functools import cache
from itertools import combinations
from typing import Any, TypeVar

from evs.emulator.config import SensorConfig
from evs.emulator.config.declaration import declaration
from evs.emulator.config.plain_values import plain_config, plain_integer, plain_number
from evs.emulator.sensor.bias_laws import effective
from evs.emulator.sensor.presets import flat, preset_biases, resolve_sensor
from evs.emulator.sensor.random import indexed_normals, indexed_uniforms
from evs.msgs import EvsError, nearest_first, unknown

TERM = 160
"""what these random numbers are for, beside the terms of sensor/random.py"""

NOMINAL = "nominal"
"""stands for the value that the sensor has without ranges"""

FIXED = ("width", "height")
"""the image has one size in all episodes"""

DIGITS = 6
"""significant digits of a value"""

MOST_DEVIATIONS = 5.0
"""of a normal number from its mean; it is drawn again where it is farther, once in 1.7 million"""

LEAST_SHARE = 0.01
"""of a normal distribution that lies in the range of its key; it is drawn again until it does"""

MOST_DRAWS = 10_000
"""of a normal number: at LEAST_SHARE, all of them miss once in 10^43 draws"""

_EXACT = Context(prec=30)

_TEXT = re.compile(r"\s*(\w+)\s*\(([^()]*)\)\s*(?:\*\s*([\w.]+)\s*)?")

_SHOW = "write it as in 'uniform(0.15, 0.35)'"

Number = int | float

C = TypeVar("C")

Ranges = Mapping[str, str]
"""key of [sensor] -> its range"""


@dataclass(frozen=True)
class Key:
    """A numeric key of [sensor]."""

    name: str
    whole: bool
    """whether its values are whole numbers"""
    within: tuple[float, float]
    """lowest and highest value that it is declared to have"""


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
    """Ranges of a sensor's parameters, checked; `draw` gives the sensor of an episode.

        ranges = SensorRanges({"pos_thres": "uniform(0.15, 0.35)"}, "davis346")
        camera = evs.EventCamera(model, sensor=ranges.draw(seed=1, episode=0).config)

    Equal arguments give equal sensors, in any process and on any machine.
    """

    def __init__(self, ranges: Ranges, sensor: str | SensorConfig = "davis346") -> None:
        """Check the ranges.

        Args:
            ranges: Key of [sensor] -> its range, as described above.
            sensor: Name of a preset, or a configuration, which gives all other values.

        Raises:
            EvsError: No such key or distribution, a range outside the key's own, or values that
                make no sensor.
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
        parsed = {key: _Range.parse(key, text, keys) for key, text in self.ranges.items()}
        # those that others refer to come first
        order = sorted(parsed.values(), key=lambda one: (one.times in parsed, one.key.name))
        self._parts = [one.bound(nominal, parsed) for one in order]
        self._check_sensors()

    def draw(self, seed: int, episode: int = 0) -> DrawnSensor:
        """Draw the sensor of an episode.

        Args:
            seed: Any whole number; it counts modulo 2^64.
            episode: Number of the episode, 0 ... 2^63 - 1.

        Raises:
            EvsError: Seed or episode is no such number.
        """
        seed, episode = plain_integer(seed, "seed"), plain_integer(episode, "episode")
        if not 0 <= episode < 2**63:
            raise EvsError(f"episode is {episode}; give 0 ... 2^63 - 1")
        values: dict[str, Number] = {}
        for part in self._parts:
            values[part.key.name] = part.draw(seed, episode, values)
        values = dict(sorted(values.items()))
        return DrawnSensor(sensor_with_values(self.sensor, values), values, seed, episode)

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
        sensor: Name of a preset, or a configuration, which gives all other values.
        ranges: Key of [sensor], dotted inside its tables, such as readout.scan_us -> one of
            uniform(low, high), log_uniform(low, high), normal(mean, deviation) and
            choice(a, b, ...); behind it `* nominal` or `* KEY` multiplies it.
        seed: Any whole number.
        episode: Number of the episode, 0 or more.

    Returns:
        The sensor with a value for every key of `ranges`.

    Raises:
        EvsError: A key, a range or a number makes no sense; one line.
    """
    return SensorRanges(ranges, sensor).draw(seed, episode).config


def sensor_with_values(sensor: str | SensorConfig, values: Mapping[str, Number]) -> SensorConfig:
    """A sensor with some values, by dotted key: what a record of a randomised sensor holds.

    Args:
        sensor: Name of a preset, or a configuration.
        values: Key of [sensor], such as pos_thres or readout.scan_us -> value.

    Raises:
        EvsError: There is no such numeric key, or a value is no number.
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


@dataclass(frozen=True)
class _Range:
    """One range, parsed."""

    key: Key
    text: str
    kind: str
    numbers: tuple[float, ...]
    times: str
    """empty, NOMINAL, or the key that it is multiplied with"""
    factor: float | None = None
    """what it is multiplied with, if that is the same in every episode"""
    factors: tuple[float, float] = (1.0, 1.0)
    """the lowest and the highest factor"""

    @classmethod
    def parse(cls, name: str, text: str, keys: Mapping[str, Key]) -> _Range:
        """Parse a range. Raises EvsError where the text is none."""
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
        found = _TEXT.fullmatch(text) if isinstance(text, str) else None
        if found is None:
            raise EvsError(f"at randomise.{name}: {text!r} is no distribution; {_SHOW}")
        kind, inside, times = found[1], found[2], found[3] or ""
        if kind not in _CHECKS:
            raise EvsError(f"at randomise.{name}: {unknown('distribution', kind, _CHECKS)}")
        try:
            numbers = tuple(float(word) for word in inside.split(","))
        except ValueError:
            numbers = (math.nan,)
        if not all(map(math.isfinite, numbers)):
            raise EvsError(f"at randomise.{name}: '{inside}' are no numbers; {_SHOW}")
        made = cls(keys[name], text, kind, numbers, times)
        if wrong := _CHECKS[kind](numbers):
            raise made.error(wrong)
        if made.whole and any(not number.is_integer() for number in numbers):
            raise made.error("its values are whole numbers; give whole ones")
        if times not in ("", NOMINAL) and (times not in keys or times == name):
            others = [NOMINAL, *(key for key in keys if key != name)]
            nearest = nearest_first(times, others)[0]
            raise made.error(f"no factor '{times}'; nearest known: {nearest}")
        return made

    def error(self, what: str) -> EvsError:
        """An error of this range."""
        return EvsError(f"at randomise.{self.key.name}: '{self.text}': {what}")

    @property
    def whole(self) -> bool:
        """Whether the distribution itself has whole values."""
        return self.key.whole and not self.times and self.kind in ("uniform", "choice")

    @property
    def ends(self) -> tuple[Number, ...]:
        """The values at the ends, lowest first; for a choice all of them."""
        low, high = self.factors
        if self.kind == "normal":
            lowest, highest = self.support
            return self._value(lowest), self._value(highest)
        found = {self._value(number * factor) for number in self.numbers for factor in (low, high)}
        return tuple(sorted(found))

    def bound(self, nominal: Mapping[str, Number], others: Mapping[str, _Range]) -> _Range:
        """The range with its factors, checked against the key's own range. Raises EvsError."""
        made = self
        if self.times:
            source = self.key.name if self.times == NOMINAL else self.times
            other = None if self.times == NOMINAL else others.get(source)
            if other is None:
                if source not in nominal:
                    raise self.error(f"this sensor has no {source}; give a range without factor")
                factor = float(nominal[source])
                made = replace(self, factor=factor, factors=(factor, factor))
            elif other.times not in ("", NOMINAL):
                raise self.error(f"{source} has a factor of its own; refer to {other.times}")
            else:
                made = replace(self, factors=other.bound(nominal, others).support)
            if not made.factors[0] > 0:
                verb = "may be" if made.factor is None else "is"
                raise self.error(
                    f"{source} {verb} {made.factors[0]:g}, and a factor must be over 0; give a "
                    "range without it"
                )
        made.check_within()
        return made

    @property
    def support(self) -> tuple[float, float]:
        """The lowest and the highest value."""
        if self.kind == "normal":
            (mean, deviation), (lowest, highest) = self.numbers, self.key.within
            ends = (mean - MOST_DEVIATIONS * deviation, mean + MOST_DEVIATIONS * deviation)
            products = [end * factor for end in ends for factor in self.factors]
            return max(min(products), lowest), min(max(products), highest)
        values = self.ends
        return float(values[0]), float(values[-1])

    def check_within(self) -> None:
        """Raise EvsError where values lie outside the key's own range."""
        lowest, highest = self.key.within
        of = f"{lowest:g} ... {highest:g}"
        for factor in self.factors:
            for number in self.numbers[: 1 if self.kind == "normal" else None]:
                if not lowest <= number * factor <= highest:
                    raise self.error(f"{number * factor:g} is outside {of}, the range of the key")
            if self.kind == "normal":
                mean, deviation = self.numbers
                low, high = ((end / factor - mean) / deviation for end in (lowest, highest))
                if _share_between(low, high) < LEAST_SHARE:
                    raise self.error(f"hardly any of it lies in {of}; give uniform({of})")

    def draw(self, seed: int, episode: int, values: Mapping[str, Number]) -> Number:
        """The value of an episode, after the keys that it refers to."""
        factor = self.factor
        if factor is None:
            factor = float(values[self.times]) if self.times else 1.0
        number = zlib.crc32(self.key.name.encode())
        if self.kind == "normal":
            return self._draw_normal(seed, episode, number, factor)
        share = float(indexed_uniforms(seed, TERM, episode, [number])[0])
        numbers = self.numbers
        if self.kind == "choice":
            return self._value(numbers[math.floor(share * len(numbers))] * factor)
        low, high = numbers
        if self.whole:
            return int(low) + math.floor(share * (high - low + 1))
        if self.kind == "uniform":
            found = _at_place(low + share * (high - low), max(abs(low), abs(high)))
        else:
            with localcontext(_EXACT):
                first, last = Decimal(low).ln(), Decimal(high).ln()
                found = float((first + Decimal(share) * (last - first)).exp())
            found = _at_place(found, found)
        return self._value(min(max(found, low), high) * factor)

    def _draw_normal(self, seed: int, episode: int, number: int, factor: float) -> Number:
        mean, deviation = self.numbers
        lowest, highest = self.key.within
        for first in range(0, MOST_DRAWS, 16):
            # far from each other: counters of keys differ in their low 32 bits
            counters = [(place << 32) + number for place in range(first, first + 16)]
            for normal in indexed_normals(seed, TERM, episode, counters).tolist():
                found = _at_place(mean + deviation * normal, max(abs(mean), deviation))
                if abs(normal) <= MOST_DEVIATIONS and lowest <= found * factor <= highest:
                    return self._value(found * factor)
        return self._value(mean * factor)

    def _value(self, value: float) -> Number:
        """As the key has it, in its own range: a product may be rounded out of it."""
        if self.key.whole:
            value = round(value)
        elif self.times:
            value = _at_place(value, value)
        lowest, highest = self.key.within
        value = min(max(value, lowest), highest)
        return int(value) if self.key.whole else float(value)


def _at_place(value: float, scale: float) -> float:
    """Rounded to DIGITS significant digits of a number as large as `scale`."""
    if not scale:
        return value
    exponent = int(f"{scale:e}".partition("e")[2])
    return round(value, DIGITS - 1 - exponent)


def _share_between(low: float, high: float) -> float:
    """Share of standard normal numbers between two."""
    return (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0))) / 2.0


def _wrong_interval(numbers: tuple[float, ...]) -> str:
    if len(numbers) != 2:
        return "give the lowest and the highest value"
    return "" if numbers[0] < numbers[1] else "give the lower value first"


def _wrong_log_interval(numbers: tuple[float, ...]) -> str:
    positive = min(numbers) > 0
    return _wrong_interval(numbers) or ("" if positive else "both values must be over 0")


def _wrong_normal(numbers: tuple[float, ...]) -> str:
    if len(numbers) != 2:
        return "give the mean and the standard deviation"
    return "" if numbers[1] > 0 else "the standard deviation must be over 0"


def _wrong_choice(numbers: tuple[float, ...]) -> str:
    return "" if len(set(numbers)) == len(numbers) else "a value stands there twice"


_CHECKS = {
    "uniform": _wrong_interval,
    "log_uniform": _wrong_log_interval,
    "normal": _wrong_normal,
    "choice": _wrong_choice,
}
"""distribution -> what is wrong with its numbers, empty: nothing"""
