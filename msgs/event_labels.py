"""Labels of events: their cause and the geom they show, which only an emulator knows."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

LABEL_DTYPE = np.dtype(
    {"names": ["cause", "geom_id"], "formats": ["u1", "<i4"], "offsets": [0, 4], "itemsize": 8}
)
"""cause: a Cause; geom_id: MuJoCo's, of what the pixel's centre showed at the end of the tick, -1
nothing, skins, flexes, sites and tendons as in GroundTruth."""

Labels = np.ndarray[Any, np.dtype[np.void]]
"""(n,) LABEL_DTYPE, in the order of the events they belong to."""

CAUSE_BYTE = 13
"""byte of an event that holds its cause between the pixel and the packet, if labels are requested;
zero in every packet"""


class Cause(IntEnum):
    """Why an event came about. A number never changes its meaning."""

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


def take_labels(events: np.ndarray[Any, Any], geom_id: np.ndarray[Any, Any]) -> Labels:
    """Move the causes from the padding of events into labels.

    Args:
        events: (n,) EVENT_DTYPE, contiguous; their padding is zero afterwards.
        geom_id: (h, w) geom at the centre of each pixel.

    Returns:
        (n,) LABEL_DTYPE.
    """
    labels = np.zeros(len(events), LABEL_DTYPE)
    causes = events.view(np.uint8).reshape(-1, events.dtype.itemsize)[:, CAUSE_BYTE]
    labels["cause"] = causes
    causes[:] = 0
    labels["geom_id"] = geom_id[events["y"], events["x"]]
    return labels


def clear_causes(events: np.ndarray[Any, Any]) -> None:
    """Set the causes in the padding of events to zero.

    Args:
        events: (n,) EVENT_DTYPE, contiguous, changed in place.
    """
    events.view(np.uint8).reshape(-1, events.dtype.itemsize)[:, CAUSE_BYTE] = 0
