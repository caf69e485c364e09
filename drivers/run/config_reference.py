"""What every configuration key means, for people and as JSON Schema: read from its declaration."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import sys
import textwrap
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from evs.drivers.run.config import PipelineConfig
from evs.emulator.config.declaration import Declaration, declaration
from evs.emulator.config.decoding import hints_of, table_of, to_plain, to_text, variants_of


@dataclass(frozen=True)
class Key:
    """One configuration key, for people."""

    name: str
    """dotted, as on the command line; `N` stands for a place in an array of tables"""
    default: str
    """as one would type it"""
    doc: str
    """what it means, on one line; empty where nothing is declared"""
    value: Any = None
    """the default"""
    example: Any = None
    """a value to show where the default is none"""


@dataclass(frozen=True)
class Table:
    """The keys of one class."""

    name: str
    """`scene` for [scene], `sink.N` for [[sink]], empty for the top level"""
    doc: str
    """first paragraph of the class's docstring, on one line"""
    keys: tuple[Key, ...]


def describe(cls: type) -> list[Table]:
    """Every table of a configuration class, the top level first, and every key in it."""
    return _describe(cls, "")


def _describe(cls: type, prefix: str) -> list[Table]:
    hints = hints_of(cls)
    docs = field_docs(cls)
    keys: list[Key] = []
    tables: list[Table] = []
    for field in dataclasses.fields(cls):
        inner, many = table_of(hints[field.name])
        if inner is not None:
            tables += _variants(inner, f"{prefix}{field.name}.{'N.' if many else ''}")
        else:
            default, declared = _default(field), declaration(field)
            example = declared.example if declared else None
            doc = docs.get(field.name, "")
            keys.append(Key(prefix + field.name, to_text(default), doc, default, example))
    top = Table(prefix.rstrip("."), _first_line(cls), tuple(keys))
    return [top, *tables]


HEAD = """\
# Every key of a pipeline with its default. Copy this file and keep the lines that you change.
# Run it with: evs emulate mine.toml [key=value ...]
# A line that begins with "# key =" shows a key that is not set, with a value as an example; those
# of [sensor] are the values of the preset, and biases are those of their chips.
# Paths are relative to this file; package:path is a file inside an installed Python package.
"""


def default_pipeline(cls: type) -> str:
    """The text of config/pipelines/default.toml: every key, its default and what it means."""
    lines = [HEAD]
    examples = _sensor_values()
    for table in describe(cls):
        array = table.name.endswith(".N")
        name = table.name.removesuffix(".N")
        mark = "# " if array else ""
        if name:
            about = table.doc.partition(": ")[2] or table.doc
            about = about[0].upper() + about[1:]
            lines += ["", *(f"# {line}" for line in textwrap.wrap(about, 96))]
            lines.append(f"{mark}[[{name}]]" if array else f"[{name}]")
        for key in table.keys:
            bare = key.name.rpartition(".")[2]
            if (shown := key.value) is None:
                shown = examples.get(key.name, True if key.example is None else key.example)
            elif array and key.example is not None:
                shown = key.example
            unset = array or key.value is None
            lead = f"{'# ' if unset else ''}{bare} = {to_text([shown])[1:-1]}"
            doc = textwrap.wrap("" if bare == "type" and key.value else key.doc, 96)
            lines.append(f"{lead:26s} # {doc[0]}" if doc else lead)
            lines += [f"{'':26s} # {line}" for line in doc[1:]]
    return "\n".join(lines) + "\n"


def _sensor_values() -> dict[str, Any]:
    """Dotted key of [sensor] -> its value in the default preset, or the nominal bias of a chip."""
    # here, so that --help needs no sensor
    from evs.emulator.config import SensorConfig
    from evs.emulator.sensor import preset_biases, preset_names, resolve_sensor
    from evs.emulator.sensor.presets import flat

    found = {f"sensor.{key}": value for key, value in flat(resolve_sensor(SensorConfig()))}
    for biases in filter(None, map(preset_biases, preset_names())):
        for key, value in biases.values.items():
            found.setdefault(f"sensor.biases.{key}", value)
    return found


def _variants(cls: type, prefix: str) -> list[Table]:
    """The tables of a class; of one of several types first what all of them have."""
    found = [_describe(kind, prefix) for kind in variants_of(cls)]
    if len(found) == 1:
        return found[0]
    common = [key for key in found[0][0].keys if all(key in own.keys for own, *_ in found)]
    own = [
        dataclasses.replace(table, keys=tuple(key for key in table.keys if key not in common))
        for tables in found
        for table in tables
    ]
    (kind,) = (key for key in found[0][0].keys if key.name == f"{prefix}type")
    kind = dataclasses.replace(kind, default='""', value="", example=kind.value)
    return [Table(prefix.rstrip("."), _first_line(cls), (kind, *common)), *own]


def _first_line(cls: type) -> str:
    """The first paragraph of the docstring of a class, on one line."""
    return " ".join((inspect.getdoc(cls) or "").split("\n\n")[0].split())


def field_docs(cls: type) -> dict[str, str]:
    """What each field of a dataclass means, on one line; base classes included.

    The declaration of the field (evs.emulator.config.declaration), with unit and range; where it
    has none, the string below it in the source.
    """
    declared = {field.name: declaration(field) for field in dataclasses.fields(cls)}
    docs = {name: one.text for name, one in declared.items() if one is not None}
    for base in reversed(cls.__mro__):
        if not dataclasses.is_dataclass(base):
            continue
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        assert isinstance(body, ast.ClassDef)
        for before, after in zip(body.body, body.body[1:], strict=False):
            if not (isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name)):
                continue
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                docs[before.target.id] = " ".join(str(after.value.value).split())
    return docs


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


DIALECT = "http://json-schema.org/draft-07/schema#"
"""The dialect that editors of TOML know."""

_PLAIN = {bool: "boolean", int: "integer", float: "number", str: "string"}

Schema = dict[str, Any]


def pipeline_schema() -> Schema:
    """The JSON Schema of a pipeline file: its tables, keys, types, ranges, defaults and meaning."""
    schema = _table(PipelineConfig)
    keys = schema["properties"]
    keys["randomise"] = {
        "type": "object",
        "description": "ranges for keys of [sensor], as in cutoff_hz = 'uniform(100, 300)', and of "
        "the scene, in a table [randomise.scene]",
        "additionalProperties": {"type": ["string", "object"]},
    }
    return {"$schema": DIALECT, "title": "A pipeline of evs", **schema}


def _table(cls: type) -> Schema:
    """A class as an object of its fields; one of several types has the keys of all."""
    if not dataclasses.is_dataclass(cls):
        tables = [_table(kind) for kind in variants_of(cls)]
        every = {name: key for table in tables for name, key in table["properties"].items()}
        every["type"] = {**every["type"], "enum": list(getattr(cls, "variants", ()))}
        every["type"].pop("default", None)
        return {**tables[0], "properties": every}
    hints, docs = hints_of(cls), field_docs(cls)
    keys = {}
    for field in dataclasses.fields(cls):
        declared = declaration(field)
        key = _value(hints[field.name], declared)
        if doc := docs.get(field.name):
            key["description"] = doc
        default = to_plain(field.default)
        if field.default is not dataclasses.MISSING and default not in (None, []):
            key["default"] = default
        keys[field.name] = key
    return {"type": "object", "properties": keys, "additionalProperties": False}


def _value(annotation: Any, declared: Declaration | None) -> Schema:
    """What a field may be. None is no value of TOML: the key is left out instead."""
    if (inner := table_of(annotation)[0]) is annotation and inner:
        return _table(inner)
    kind = typing.get_origin(annotation)
    if kind in (typing.Union, types.UnionType):
        kinds = [one for one in typing.get_args(annotation) if one is not types.NoneType]
        found = [_value(one, declared) for one in kinds]
        return found[0] if len(found) == 1 else {"anyOf": found}
    if kind is tuple:
        items = typing.get_args(annotation)
        schema: Schema = {"type": "array", "items": _value(items[0], declared)}
        if items[1:] != (...,):
            schema |= {"minItems": len(items), "maxItems": len(items)}
        return schema
    if kind is not None and issubclass(kind, Mapping):
        return {"type": "object"}
    schema = {"type": _PLAIN[annotation]}
    if declared is not None and declared.choices and annotation is str:
        schema["enum"] = list(declared.choices)
    if declared is not None and declared.within is not None and annotation in (int, float):
        schema["minimum"], schema["maximum"] = declared.within
    return schema


if __name__ == "__main__":
    sys.stdout.write(default_pipeline(PipelineConfig))
