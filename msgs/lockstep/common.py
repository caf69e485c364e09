"""What both directions of lock-step share: limits, and fields of a header."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.fields import MAX_INT64, MessageError, check_name, integer, shown
from evs.msgs.packet import MAX_HEADER_BYTES, unpackb

F64 = npt.NDArray[np.float64]

LOCKSTEP_ADDRESS = "tcp://127.0.0.1:5570"
"""Where a closed loop is served if nothing else is said."""

LOCKSTEP_PROTOCOL = 1
"""Version of what is said here; a client of another one should not guess."""

MAX_BLOB_BYTES = 1 << 30
"""Largest saved state that travels."""

MAX_TICKS = 1_000_000
"""Most ticks of one step."""

MOST_NAMES = 1000
"""Most actuators or cameras: lists in a header have no more items."""

Parts = list[Any]
"""Frames of a message: bytes, or a buffer of contiguous memory."""


def number_of(header: bytes) -> tuple[int, dict[str, Any]]:
    """The number of a message and all of its header's fields. MessageError: it is none of ours."""
    fields = unpackb(header, MAX_HEADER_BYTES)
    return integer(fields, "number", 0, MAX_INT64), fields


def line_of(fields: dict[str, Any], key: str) -> str:
    """A field that is a short text, perhaps empty."""
    value = fields.get(key)
    if not isinstance(value, str):
        raise MessageError(f"header field {key!r} is {shown(value)}, not a text")
    return value


def names_of(fields: dict[str, Any], key: str) -> tuple[str, ...] | None:
    """A field that is a list of names; None where there is none."""
    found = fields.get(key)
    if found is None:
        return None
    if not isinstance(found, list):
        raise MessageError(f"header field {key!r} is {shown(found)}, not a list of names")
    for one in found:
        check_name(one, f"a name in header field {key!r}")
    return tuple(found)


def floats(raw: Any, what: str) -> F64:
    """The float64 numbers of a raw frame."""
    if len(raw) % 8:
        raise MessageError(f"{what}: {len(raw)} bytes are not whole float64 numbers")
    return np.frombuffer(raw, "<f8")
