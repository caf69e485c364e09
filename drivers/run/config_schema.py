"""A pipeline file as JSON Schema, with which editors complete and check its keys."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any

from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.config_keys import field_docs
from evs.emulator.config.declaration import Declaration, declaration
from evs.emulator.config.settings import hints_of, table_of, to_plain, variants_of

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
