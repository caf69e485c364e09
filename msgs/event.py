"""The event: 16 bytes everywhere, laid out as AEDAT4's event struct and as the bus frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

EVENT_DTYPE = np.dtype(
    {
        "names": ["t", "x", "y", "p"],
        "formats": ["<i8", "<i2", "<i2", "i1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)
"""t int64 us of simulated time; x, y int16 px from the top left; p int8 1 ON, 0 OFF; 3 zeros."""

_HALVES = np.dtype("<u8")

Events = np.ndarray[Any, np.dtype[np.void]]
"""(n,) EVENT_DTYPE, sorted by t."""


def empty_events(count: int = 0) -> Events:
    """`count` zeroed events. Always zeros: padding bytes of np.empty would leak memory."""
    return np.zeros(count, EVENT_DTYPE)


def make_events(t: npt.ArrayLike, x: npt.ArrayLike, y: npt.ArrayLike, p: npt.ArrayLike) -> Events:
    """Events from four arrays of one length: t (n,) us, x (n,) px, y (n,) px, p (n,) 0 or 1."""
    stamps = np.asarray(t, np.int64)
    events = empty_events(len(stamps))
    events["t"], events["x"], events["y"], events["p"] = stamps, x, y, p
    return events


def join_events(parts: Sequence[Events]) -> Events:
    """The parts one after the other. np.concatenate would give 13-byte items of another dtype."""
    joined = empty_events(sum(len(part) for part in parts))
    end = 0
    for part in parts:
        joined[end : end + len(part)], end = part, end + len(part)
    return joined


def clean_events(events: Events) -> Events:
    """Make events contiguous, with zero padding. Call it before handing out raw bytes.

    numpy copies only the fields, so the padding is garbage of freed memory after `events.copy()`,
    `events[mask]` or sorting.

    Args:
        events: (n,) with EVENT_DTYPE's fields.

    Returns:
        (n,) EVENT_DTYPE; the same array where it is contiguous and clean already.
    """
    packed = np.ascontiguousarray(events, EVENT_DTYPE)
    # bits 40-63 of an event's second half are the padding
    if len(packed) == 0 or int(np.bitwise_or.reduce(packed.view(_HALVES)[1::2])) >> 40 == 0:
        return packed
    return join_events([packed])
