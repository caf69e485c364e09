"""One hash of nested values: only equal values have the same hash."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from evs.msgs import EvsError


def digest(value: Any) -> str:
    """32 hexadecimal digits of dataclasses, tuples, lists, arrays, numbers, texts, enums, None."""
    hashed = hashlib.blake2b(digest_size=16)
    for part in _parts(value):
        hashed.update(len(part).to_bytes(8, "little"))
        hashed.update(part)
    return hashed.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """Type, then content; the length of each part is hashed too, which keeps parts apart."""
    # a class that was renamed keeps its name here, so that old digests stay valid
    yield getattr(type(value), "DIGEST_NAME", type(value).__name__).encode()
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str} {value.shape}".encode()
        yield value.tobytes()
    elif isinstance(value, np.generic):
        yield value.tobytes()
    elif isinstance(value, Enum):
        yield value.name.encode()
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield field.name.encode()
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, tuple | list):
        yield str(len(value)).encode()
        for inner in value:
            yield from _parts(inner)
    elif isinstance(value, dict):
        yield from _parts(sorted(value.items()))
    elif value is None or isinstance(value, bool | int | str):
        yield str(value).encode()
    elif isinstance(value, float):
        yield value.hex().encode()
    else:
        raise EvsError(f"{type(value).__name__} cannot be hashed; give plain values and arrays")
