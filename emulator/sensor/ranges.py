"""Checks of sensor parameters against their declarations."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, get_args

from evs.emulator.config.declaration import Declaration, declaration
from evs.msgs import EvsError, unknown


def check_declared(table: str, parameters: Any) -> None:
    """Check every declared value of a dataclass: its type, its range, the words that it may be.

    Args:
        table: `sensor.aps` for [sensor.aps], for messages.
        parameters: An instance of a class whose fields are made by `declaration.parameter`.

    Raises:
        EvsError: A value is not of its type, or out of its range; the message has its key.
    """
    for field in fields(parameters):
        if (declared := declaration(field)) is not None:
            key, value = f"{table}.{field.name}", getattr(parameters, field.name)
            _check(key, value, field.type, declared)


def _check(key: str, value: Any, kind: Any, declared: Declaration) -> None:
    items = get_args(kind)
    if kind is bool and not isinstance(value, bool):
        raise EvsError(f"{key} is {value!r}; give true or false")
    if declared.choices and value not in declared.choices:
        raise unknown(f"{declared.noun} ({key})", str(value), declared.choices)
    if kind is int and not is_whole(value):
        raise EvsError(f"{key} is {value!r}; give a whole number")
    if len(items) == 3 and (not isinstance(value, tuple) or len(value) != 3):
        raise EvsError(f"{key} is {value!r}; give three numbers: x, y, z")
    if declared.within is None:
        return
    lowest, highest = declared.within
    shown = "d" if kind is int else "g"
    for item in value if isinstance(value, tuple) else (value,):
        if not isinstance(item, int | float) or isinstance(item, bool):
            raise EvsError(f"{key} is {value!r}; give a number")
        if not lowest <= item <= highest:  # also where it is NaN
            raise EvsError(f"{key} is {item:{shown}}; give {lowest:{shown}} ... {highest:{shown}}")


def is_whole(value: Any) -> bool:
    """Whether it is an int, and no bool."""
    return isinstance(value, int) and not isinstance(value, bool)
