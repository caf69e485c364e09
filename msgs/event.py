"""The event: 16 bytes everywhere, laid out as AEDAT4's event struct and as the bus frame; labels.

Labels are what only an emulator knows of an event: its cause, and the geom that it shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
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


LABEL_DTYPE = np.dtype(
    {
        "names": ["cause", "geom_id", "class_id", "depth", "flow"],
        "formats": ["u1", "<i4", "<i4", "<f4", ("<f4", (2,))],
        "offsets": [0, 4, 8, 12, 16],
        "itemsize": 24,
    }
)
"""cause: a Cause. The rest is of what the pixel's centre showed at the end of the tick, as in
GroundTruth: geom_id MuJoCo's, -1 nothing, skins, flexes, sites and tendons below; class_id an index
into StreamInfo.classes, -1 none; depth m, flow (x, y) px/s, both NaN where they are not known."""

Labels = np.ndarray[Any, np.dtype[np.void]]
"""(n,) LABEL_DTYPE, in the order of the events they belong to."""

CAUSE_BYTE = 13
"""byte of an event that holds its cause between the pixel and the packet, if labels are requested;
zero in every packet"""


class Cause(IntEnum):
    """The cause of an event. A number never changes its meaning."""

    UNKNOWN = 0
    """another event model made it"""
    SIGNAL = 1
    """light: it moved the pixel further in that tick than the leak did"""
    LEAK = 2
    """the reference sank"""
    SHOT = 3
    """shot noise"""
    HOT = 4
    """the leak of a hot pixel"""
    APS = 5
    """the read of the pixel's row in an intensity frame"""


def take_labels(
    events: np.ndarray[Any, Any],
    geom_id: np.ndarray[Any, Any],
    class_of_geom: np.ndarray[Any, Any] | None = None,
    depth: np.ndarray[Any, Any] | None = None,
    flow: np.ndarray[Any, Any] | None = None,
) -> Labels:
    """Move the causes from the padding of events into labels.

    Args:
        events: (n,) EVENT_DTYPE, contiguous; their padding is zero afterwards.
        geom_id: (h, w) geom at the centre of each pixel.
        class_of_geom: (k,) class of each geom_id, whose negative values count from the end; None:
            -1 everywhere.
        depth: (h, w) m; None: NaN everywhere.
        flow: (h, w, 2) px/s; None: NaN everywhere.

    Returns:
        (n,) LABEL_DTYPE.
    """
    labels = np.zeros(len(events), LABEL_DTYPE)
    causes = events.view(np.uint8).reshape(-1, events.dtype.itemsize)[:, CAUSE_BYTE]
    labels["cause"] = causes
    causes[:] = 0
    there = events["y"], events["x"]
    labels["geom_id"] = geom_id[there]
    labels["class_id"] = -1 if class_of_geom is None else class_of_geom[labels["geom_id"]]
    labels["depth"] = np.nan if depth is None else depth[there]
    labels["flow"] = np.nan if flow is None else flow[there]
    return labels


def clear_causes(events: np.ndarray[Any, Any]) -> None:
    """Set the causes in the padding of events to zero.

    Args:
        events: (n,) EVENT_DTYPE, contiguous, changed in place.
    """
    events.view(np.uint8).reshape(-1, events.dtype.itemsize)[:, CAUSE_BYTE] = 0
