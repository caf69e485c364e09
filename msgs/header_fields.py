"""Validation of the fields of a message header."""

from __future__ import annotations

import math
import reprlib
from typing import Any

from evs.msgs.errors import EvsError

MAX_INT64 = 2**63 - 1
"""Times and counts are int64 everywhere."""

MAX_PIXELS = 2**15 - 1
"""Widest and highest sensor: x and y are int16."""

MAX_NAME_BYTES = 255
"""Longest name of a camera or a sensor, in UTF-8."""


class MessageError(EvsError):
    """Bytes from outside that are not a valid message, or values that do not fit into one."""


def integer(fields: dict[str, Any], key: str, lowest: int, highest: int) -> int:
    """An integer field within lowest ... highest, both included. True and 1.0 are not integers."""
    value = fields.get(key)
    if type(value) is int and lowest <= value <= highest:
        return value
    value = _present(fields, key)
    if not isinstance(value, int) or isinstance(value, bool):
        raise MessageError(f"header field {key!r} is {shown(value)}, not an integer")
    if not lowest <= value <= highest:
        raise MessageError(f"header field {key!r} is {value}, not in {lowest} ... {highest}")
    return value


def boolean(fields: dict[str, Any], key: str) -> bool:
    """A field that is true or false."""
    value = _present(fields, key)
    if not isinstance(value, bool):
        raise MessageError(f"header field {key!r} is {shown(value)}, not true or false")
    return value


def numbers(fields: dict[str, Any], key: str, least: int, most: int) -> tuple[float, ...]:
    """A field that is a list of least ... most finite numbers."""
    value = _present(fields, key)
    if not isinstance(value, list) or not least <= len(value) <= most:
        wanted = str(least) if least == most else f"{least} ... {most}"
        raise MessageError(f"header field {key!r} is {shown(value)}, not {wanted} numbers")
    if not all(type(one) in (int, float) and math.isfinite(one) for one in value):
        raise MessageError(f"header field {key!r} holds what is no finite number: {shown(value)}")
    return tuple(map(float, value))


def name(fields: dict[str, Any], key: str) -> str:
    """A field that holds a name, see check_name."""
    value = _present(fields, key)
    check_name(value, f"header field {key!r}")
    return str(value)


def check_name(value: object, what: str) -> None:
    """MessageError unless `value` can name a camera: printable, not empty, at most 255 bytes."""
    if not isinstance(value, str):
        raise MessageError(f"{what} is {shown(value)}, not a name")
    # an unprintable name could play tricks on a terminal; a lone surrogate has no UTF-8
    if not value or not value.isprintable() or len(value.encode()) > MAX_NAME_BYTES:
        raise MessageError(
            f"{what} is {shown(value)}: a name is 1 ... {MAX_NAME_BYTES} printable bytes"
        )


def shown(value: object) -> str:
    """A value from outside as one short line, for messages."""
    return reprlib.repr(value) if not isinstance(value, str) else repr(value[:60])


def _present(fields: dict[str, Any], key: str) -> Any:
    if key not in fields:
        raise MessageError(f"header lacks {key!r}")
    return fields[key]
