"""How many events a pixel has in 1/60 s, and how even their stamps are.

Voxels are those of the EventTracer paper's figure of event intensity: a pixel in a frame of
60 FPS. Their edges are whole milliseconds, so some are 16 ms and some 17 ms long.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from evs.msgs import Events
from reference.reconstruction import F64

MANY = 10
"""events in a voxel that the paper calls a high intensity"""

Counts = npt.NDArray[np.int64]


def frame_times_us(frames: int) -> list[int]:
    """Times of the first frames of 60 FPS, to the nearest ms."""
    return [1000 * round(1000 * k / 60) for k in range(frames)]


def counts_of(events: Events, shape: tuple[int, int], edges_us: Sequence[int]) -> Counts:
    """Count the events of each pixel, both polarities, from one edge to the next.

    Args:
        events: In any order; those outside the edges are left out.
        shape: Height and width, px.
        edges_us: Ascending; a voxel has its later edge, not its earlier one.

    Returns:
        (edges - 1, height, width).
    """
    height, width = shape
    voxel = np.searchsorted(edges_us, events["t"], "left") - 1
    voxels = len(edges_us) - 1
    inside = (voxel >= 0) & (voxel < voxels)
    pixel = events["y"].astype(np.int64) * width + events["x"]
    cell = voxel[inside] * height * width + pixel[inside]
    return np.bincount(cell, minlength=voxels * height * width).reshape(voxels, height, width)


def histogram(counts: Counts) -> F64:
    """(most + 1,) share of the voxels with 0, 1, 2 ... events."""
    return np.bincount(counts.ravel()) / counts.size


def binned(shares: F64) -> F64:
    """(MANY + 1,) the same, the last one for MANY and more."""
    short = np.zeros(MANY + 1)
    short[: len(shares[:MANY])] = shares[:MANY]
    short[MANY] = shares[MANY:].sum()
    return short


def total_variation(one: F64, other: F64) -> float:
    """Half the sum of the differences of two binned histograms: 0 alike, 1 disjoint."""
    return float(0.5 * np.abs(binned(one) - binned(other)).sum())


def earth_mover(one: F64, other: F64) -> float:
    """Events by which a voxel has to change, on average, so that both histograms are the same."""
    longest = max(len(one), len(other))
    difference = np.pad(one, (0, longest - len(one))) - np.pad(other, (0, longest - len(other)))
    return float(np.abs(np.cumsum(difference)).sum())


def tenths(t_us: npt.NDArray[np.int64], edges_us: Sequence[int]) -> F64:
    """(10,) share of the stamps in each tenth of the time between their edges; NaN without stamps.

    Args:
        t_us: Those outside the edges are left out.
        edges_us: Ascending whole us; a span has its later edge, not its earlier one.
    """
    edges = np.asarray(edges_us)
    span = np.searchsorted(edges, t_us, "left") - 1
    inside = (span >= 0) & (span < len(edges) - 1)
    if not inside.any():
        return np.full(10, np.nan)
    begin = edges[span[inside]]
    length = edges[span[inside] + 1] - begin
    # the last us of a tenth is its own, as that of a voxel
    tenth = (10 * (t_us[inside] - begin) - 1) // length
    return np.bincount(tenth, minlength=10) / len(tenth)
