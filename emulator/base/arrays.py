"""NumPy arrays: copies whose memory begins where a cache line does, and comparison bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

LINE = 64
"""Bytes of a cache line, and of the widest register: what begins elsewhere is loaded from two."""


def on_lines(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """A copy in C order whose first byte begins a cache line."""
    memory = np.empty(array.nbytes + LINE - 1, np.uint8)
    first = -int(memory.__array_interface__["data"][0]) % LINE
    out: np.ndarray[Any, Any] = np.ndarray(array.shape, array.dtype, memory, first)
    out[...] = array
    return out


Arrays = Mapping[str, np.ndarray[Any, Any]]


def same_bytes(ours: Arrays, theirs: Arrays) -> bool:
    """Whether both have the same names, shapes and bits; a NaN equals itself."""
    return ours.keys() == theirs.keys() and all(
        array.shape == theirs[name].shape and array.tobytes() == theirs[name].tobytes()
        for name, array in ours.items()
    )
