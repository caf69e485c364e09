"""A configuration from Python, where nothing checks types, as the plain values that files hold."""

from __future__ import annotations

import math
import numbers
import os
import types
import typing
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any, TypeVar

import numpy as np

from evs.msgs import EvsError, unknown

C = TypeVar("C")


def plain_config(config: C, table: str) -> C:
    """A copy with plain values: no numpy number or array is left, so any header can hold it.

    Raises EvsError with the key where a value is not of its field's type, or not finite.
    """
    kind: type = type(config)
    hints = _hints_of(kind)
    values = {}
    for field in fields(config):  # type: ignore[arg-type]
        value = getattr(config, field.name)
        try:
            values[field.name] = _item(value, hints[field.name], f"{table}.{field.name}")
        except (TypeError, ValueError):
            wanted = _in_words(hints[field.name])
            raise EvsError(f"{table}.{field.name} is {value!r}; give {wanted}") from None
    return replace(config, **values)  # type: ignore[type-var]


def with_keys(config: C, keys: Mapping[str, Any], table: str) -> C:
    """A copy with some keys set; `plain_config` checks the values.

    Args:
        config: A dataclass of the configuration.
        keys: key -> value. A key of a table inside is dotted, or the value is a dict of its keys.
        table: Of `config`, for messages.

    Raises:
        EvsError: An unknown key; the message has the nearest ones.
    """
    for key, value in keys.items():
        name, _, rest = key.partition(".")
        known = [field.name for field in fields(config)]  # type: ignore[arg-type]
        if name not in known:
            raise unknown("key", f"{table}.{name}", [f"{table}.{each}" for each in known])
        before = getattr(config, name)
        if rest and not is_dataclass(before):
            raise EvsError(f"{table}.{name} is no table: it has no key {rest}")
        if is_dataclass(before) and (rest or isinstance(value, Mapping)):
            inside = {rest: value} if rest else value
            value = with_keys(before, inside, f"{table}.{name}")
        config = replace(config, **{name: value})  # type: ignore[type-var]
    return config


@cache
def _hints_of(kind: type) -> dict[str, Any]:
    """The types of a class's fields; finding them takes longer than all else here."""
    return typing.get_type_hints(kind)


def plain_integer(value: Any, name: str) -> int:
    """`value` as an int; EvsError where it is no whole number."""
    try:
        return int(_plain(value, int))
    except TypeError:
        raise EvsError(f"{name} is {value!r}; give a whole number") from None


def plain_number(value: Any, name: str) -> float:
    """`value` as a float; EvsError where it is no finite number."""
    try:
        return float(_plain(value, float))
    except TypeError:
        raise EvsError(f"{name} is {value!r}; give a number") from None


def _plain(value: Any, hint: Any, name: str = "") -> Any:
    """`value` as `hint` has it; TypeError or ValueError where it does not fit.

    Args:
        value: Any value.
        hint: Type of the field.
        name: Of the key, for messages about an item of the value.
    """
    kinds = _kinds(hint)
    if value is None and type(None) in kinds:
        return None
    for kind in kinds:
        if typing.get_origin(kind) is tuple and isinstance(value, tuple | list | np.ndarray):
            items = typing.get_args(kind)
            if items[1:] == (Ellipsis,):
                items = items[:1] * len(value)
            pairs = zip(value, items, strict=True)
            return tuple(_item(v, k, f"{name}.{n}") for n, (v, k) in enumerate(pairs))
        if kind is bool and isinstance(value, bool | np.bool_):
            return bool(value)
        if kind is str and isinstance(value, str | os.PathLike):
            return os.fspath(value)
        # Python counts True as 1
        if isinstance(value, bool | np.bool_):
            continue
        if kind is int and isinstance(value, numbers.Integral):
            return int(value)
        if kind is float and isinstance(value, numbers.Real) and math.isfinite(value):
            return float(value)
    raise TypeError


def _item(value: Any, hint: Any, name: str) -> Any:
    """A plain value, or a table of its own."""
    if not (isinstance(hint, type) and is_dataclass(hint)):
        return _plain(value, hint, name)
    if not isinstance(value, hint):
        raise TypeError
    return plain_config(value, name)


def _kinds(hint: Any) -> tuple[Any, ...]:
    many = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if many else (hint,)


def _in_words(hint: Any) -> str:
    """A type in words."""
    words: dict[Any, str] = {
        bool: "True or False",
        int: "a whole number",
        float: "a finite number",
        str: "a name",
    }
    kinds = [
        _tuple_in_words(typing.get_args(kind)) if typing.get_origin(kind) is tuple else kind
        for kind in _kinds(hint)
        if kind is not type(None)
    ]
    named = [
        f"a {kind.__name__}" if isinstance(kind, type) and is_dataclass(kind) else str(kind)
        for kind in (words.get(kind, kind) for kind in kinds)
    ]
    return " or ".join([*named, *(["None"] if type(None) in _kinds(hint) else [])])


def _tuple_in_words(items: tuple[Any, ...]) -> str:
    if items[1:] == (Ellipsis,):
        plain = {float: "finite numbers", int: "whole numbers"}
        return plain.get(items[0]) or f"a tuple of {items[0].__name__}"
    return f"{len(items)} finite numbers"
