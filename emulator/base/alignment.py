"""Memory that begins where a cache line does."""

from __future__ import annotations

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
