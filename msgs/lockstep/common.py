"""Limits and header fields of both directions of lock-step."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.header_fields import MAX_INT64, MessageError, check_name, integer, shown
from evs.msgs.packet import MAX_HEADER_BYTES, unpackb

F64 = npt.NDArray[np.float64]

LOCKSTEP_ADDRESS = "tcp://127.0.0.1:5570"
"""Default address of the server of a closed loop."""

LOCKSTEP_PROTOCOL = 1
"""Version of the protocol; a client of another version is refused."""

MAX_BLOB_BYTES = 1 << 30
"""Largest saved state in a message."""

MAX_TICKS = 1_000_000
"""Most ticks of one step."""

MAX_NAMES = 1000
"""Most actuators or cameras: lists in a header have no more items."""

Parts = list[Any]
"""Frames of a message: bytes or contiguous buffers."""


def decode_header(header: bytes) -> tuple[int, dict[str, Any]]:
    """The number of a message and all fields of its header. MessageError: it is not ours."""
    fields = unpackb(header, MAX_HEADER_BYTES)
    return integer(fields, "number", 0, MAX_INT64), fields


def text_field(fields: dict[str, Any], key: str) -> str:
    """A field that holds a short text, which may be empty."""
    value = fields.get(key)
    if not isinstance(value, str):
        raise MessageError(f"header field {key!r} is {shown(value)}, not a text")
    return value


def names_field(fields: dict[str, Any], key: str) -> tuple[str, ...] | None:
    """A field that holds a list of names; None where it is missing."""
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
