"""Options of a Loop as JSON, so that a file can make the loop again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from evs.emulator import config

_CLASSES: dict[str, Any] = {
    name: one for name, one in vars(config).items() if isinstance(one, type) and is_dataclass(one)
}
"""name -> every dataclass that an option may be or hold"""

_CLASS = "class"


def plain_options(options: Mapping[str, Any]) -> dict[str, Any] | None:
    """As JSON has them; None where one is something else than numbers, words and evs's configs."""
    try:
        return {name: _plain(value) for name, value in options.items()}
    except TypeError:
        return None


def options_of(plain: Mapping[str, Any]) -> dict[str, Any]:
    """The options that `plain_options` wrote down."""
    return {name: _value(value) for name, value in plain.items()}


def _plain(value: Any) -> Any:
    if type(value) in _CLASSES.values():
        inner = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        return {_CLASS: type(value).__name__, **inner}
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise TypeError(f"{value!r} is nothing that JSON has")


def _value(plain: Any) -> Any:
    if isinstance(plain, dict) and _CLASS in plain:
        inner = {key: _value(one) for key, one in plain.items() if key != _CLASS}
        return _CLASSES[plain[_CLASS]](**inner)
    if isinstance(plain, dict):
        return {key: _value(one) for key, one in plain.items()}
    return tuple(_value(one) for one in plain) if isinstance(plain, list) else plain
