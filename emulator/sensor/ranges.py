"""Checks that parameters of every stage of a sensor share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evs.msgs import EvsError


def check_ranges(table: str, parameters: Any, ranges: Mapping[str, tuple[float, float]]) -> None:
    """EvsError unless every key is a number (or a tuple of them) within its range, both allowed."""
    for key, (lowest, highest) in ranges.items():
        given = getattr(parameters, key)
        for value in given if isinstance(given, tuple) else (given,):
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise EvsError(f"{table}.{key} is {given!r}; give a number")
            if not lowest <= value <= highest:  # also where it is NaN
                raise EvsError(f"{table}.{key} is {value:g}; give {lowest:g} ... {highest:g}")


def check_switch(table: str, parameters: Any, key: str) -> None:
    """EvsError unless the key is true or false."""
    if not isinstance(getattr(parameters, key), bool):
        raise EvsError(f"{table}.{key} is {getattr(parameters, key)!r}; give true or false")


def check_whole(table: str, parameters: Any, key: str) -> None:
    """EvsError unless the key is a whole number."""
    value = getattr(parameters, key)
    if not isinstance(value, int) or isinstance(value, bool):
        raise EvsError(f"{table}.{key} is {value!r}; give a whole number")
