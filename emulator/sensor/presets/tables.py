"""Parameters from a sensor file and a configuration: generic over classes and nested tables.

A field of a class of parameters that is itself a dataclass stands for a table: [readout] in the
sensor file, [sensor.readout] in the configuration, where every key that is None is the file's.
"""

from __future__ import annotations

import typing
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from evs.emulator.config.declaration import declaration
from evs.msgs import EvsError, unknown

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
        kind: A dataclass of parameters. A table whose field is `Table | None` is None where neither
            file nor configuration has any of its keys.
        file: The table of the sensor file. A key that is declared as a path is relative to it.
        config: A dataclass with the keys of `kind`, None where it gives nothing.
        **fixed: Values that neither gives.

    Raises:
        EvsError: An unknown or missing key, and whatever `kind` refuses.
    """
    hints = typing.get_type_hints(kind)
    known = [field.name for field in fields(kind) if field.name not in fixed]  # type: ignore[arg-type]
    for key in file.values:
        if key not in known:
            names = [file.prefix + name for name in known]
            raise unknown(f"key of sensor file {file.path}", file.prefix + key, names)
    values: dict[str, Any] = dict(fixed)
    for field in fields(kind):  # type: ignore[arg-type]
        if field.name in fixed:
            continue
        table, optional = table_of(hints[field.name])
        given = getattr(config, field.name)
        if table is not None:
            inside = file.table(field.name)
            if not optional or field.name in file.values or gives_any(given):
                values[field.name] = fill(table, inside, given)
        elif given is not None:
            values[field.name] = given
        elif field.name in file.values:
            values[field.name] = _from_file(field, file)
    _check_complete(kind, values, file)
    return kind(**values)


def table_of(hint: Any) -> tuple[type[Any] | None, bool]:
    """(the dataclass of a hint `Table` or `Table | None`, else None; whether it is optional)."""
    kinds = typing.get_args(hint) or (hint,)
    tables = [kind for kind in kinds if isinstance(kind, type) and is_dataclass(kind)]
    return (tables[0], len(kinds) > 1) if tables else (None, False)


def gives_any(config: Any) -> bool:
    """Whether any key of a table of the configuration is given, or of a table inside it."""
    values = [getattr(config, field.name) for field in fields(config)]
    return any(gives_any(v) if is_dataclass(v) else v is not None for v in values)


def _from_file(field: Field[Any], file: SensorFile) -> Any:
    value = file.values[field.name]
    if isinstance(value, list):
        return tuple(value)
    declared = declaration(field)
    if declared and declared.is_path and isinstance(value, str) and value:
        return str(file.path.parent / Path(value).expanduser())
    return value


def _check_complete(kind: type[Any], values: dict[str, Any], file: SensorFile) -> None:
    missing = [
        file.prefix + field.name
        for field in fields(kind)
        if field.default is MISSING
        and field.default_factory is MISSING
        and field.name not in values
    ]
    if missing:
        raise EvsError(
            f"sensor file {file.path} lacks {', '.join(missing)}; add it, or sensor.{missing[0]}="
        )
