"""Sensor presets: TOML files of config/sensors, or the user's own file of the same form.

`resolve_sensor` makes parameters of a preset and a configuration, key by key. A field of a class of
parameters that is itself a dataclass stands for a table: [readout] in the sensor file,
[sensor.readout] in the configuration, where every key that is None is the file's. `describe_sensor`
lists every value with its source, the comment behind it in the file.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import MISSING, Field, asdict, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from evs.emulator.base.small_files import is_file, read_small_text
from evs.emulator.config import SensorConfig
from evs.emulator.config.declaration import declaration
from evs.emulator.config.decoding import hints_of
from evs.emulator.sensor.bias_laws import Nominal, effective, nominal_biases, with_biases
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import EvsError, unknown

# config/ lies beside emulator/, in the wheel as in the checkout; links are not followed
_PRESETS = Path(__file__).absolute().parents[2] / "config" / "sensors"


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
        if not is_file(path):
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


P = TypeVar("P")


@dataclass(frozen=True)
class SensorFile:
    """One table of a sensor file."""

    path: Path
    values: dict[str, Any]
    """key -> value, or the dict of a table inside"""
    prefix: str = ""
    """where it stands in the file: empty for the top, "readout." for the table [readout]"""

    def table(self, name: str) -> SensorFile:
        """The table `name` inside; an empty one where the file has none. EvsError: not a table."""
        values = self.values.get(name, {})
        if not isinstance(values, dict):
            raise EvsError(
                f"sensor file {self.path}: {self.prefix}{name} is {values!r}; "
                f"make it a table [{self.prefix}{name}]"
            )
        return SensorFile(self.path, values, f"{self.prefix}{name}.")


def fill(kind: type[P], file: SensorFile, config: Any, **fixed: Any) -> P:
    """Make an instance of `kind`: what `config` and `fixed` give, else the file's values.

    Args:
        kind: A dataclass of parameters, and of tables of parameters.
        file: The table of the sensor file. A key that is declared as a path is relative to it.
        config: A dataclass with the keys of `kind`, None where it gives nothing.
        **fixed: Values that neither gives.

    Raises:
        EvsError: An unknown or missing key, and whatever `kind` refuses.
    """
    hints = hints_of(kind)  # type: ignore[arg-type]
    known = [name for name in hints if name not in fixed]
    for key in file.values:
        if key not in known:
            names = [file.prefix + name for name in known]
            raise unknown(f"key of sensor file {file.path}", file.prefix + key, names)
    values, missing = dict(fixed), []
    for field in (one for one in fields(kind) if one.name in known):  # type: ignore[arg-type]
        name, given = field.name, getattr(config, field.name)
        if is_dataclass(hints[name]):
            values[name] = fill(hints[name], file.table(name), given)
        elif given is not None:
            values[name] = given
        elif name in file.values:
            values[name] = _from_file(field, file)
        elif field.default is MISSING:
            missing.append(file.prefix + name)
    if missing:
        raise EvsError(
            f"sensor file {file.path} lacks {', '.join(missing)}; add it, or sensor.{missing[0]}="
        )
    return kind(**values)


def _from_file(field: Field[Any], file: SensorFile) -> Any:
    value = file.values[field.name]
    if isinstance(value, list):
        return tuple(value)
    declared = declaration(field)
    if declared and declared.is_path and isinstance(value, str) and value:
        return str(file.path.parent / Path(value).expanduser())
    return value


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


# a comment begins at the first # outside quotes
_LINE = re.compile(r"""^(?P<code>(?:[^"'#]|"[^"]*"|'[^']*')*)(?:\#(?P<comment>.*))?$""")
_TABLE = re.compile(r"^\s*\[([\w.]+)\]")
_KEY = re.compile(r"^\s*(\w+)\s*=")


@dataclass(frozen=True)
class Sources:
    """The comments of a sensor file."""

    about: str
    """the comment at its head"""
    of: dict[str, str]
    """key, dotted for one inside a table (`readout.order`) -> where its value comes from; "" where
    there is no comment"""


def read_sources(path: Path) -> Sources:
    """The comments of a sensor file that is valid TOML.

    A comment belongs to the key before it, on the same line; a line with nothing but a comment
    that is indented goes on with it.
    """
    about: list[str] = []
    of: dict[str, str] = {}
    table, key = "", ""
    for line in path.read_text(encoding="utf-8").splitlines():
        found = _LINE.match(line)
        code, comment = (found["code"], found["comment"] or "") if found else (line, "")
        comment = comment.strip()
        if header := _TABLE.match(code):
            table, key = f"{header[1]}.", ""
        elif named := _KEY.match(code):
            key = table + named[1]
            of[key] = comment
        elif comment and not of and not table:
            about.append(comment)
        elif comment and key and line[0].isspace():
            of[key] = f"{of[key]} {comment}"
        else:
            key = ""
    return Sources(" ".join(about), of)
