"""Events as a voxel grid, the input of networks that make video of events.

As E2VID has it (Rebecq et al., TPAMI 2019): an event's polarity, 1 or -1, is shared between the two
bins nearest in time.
"""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import F32
from evs.msgs import Events

LEAST_DEVIATION = 1e-6
"""of a grid whose entries are all alike"""


def voxel_grid(events: Events, bins: int, shape: tuple[int, int]) -> F32:
    """Sum of polarities in each bin and pixel.

    The first event lies in the first bin and the last one in the last; between them an event at bin
    position 1.3 gives 0.7 of its polarity to bin 1 and 0.3 to bin 2. Events of one stamp lie in the
    first bin.

    Args:
        events: sorted by t.
        bins: B, 1 or more.
        shape: height and width, px.

    Returns:
        (bins, height, width).
    """
    height, width = shape
    grid = np.zeros((bins, height * width))
    if len(events):
        t = events["t"].astype(np.int64)
        span = max(1, int(t[-1] - t[0]))
        position = (bins - 1) * (t - t[0]) / span
        polarity = np.where(events["p"] == 1, 1.0, -1.0)
        pixel = events["y"].astype(np.int64) * width + events["x"]
        first = np.minimum(position.astype(np.int64), bins - 1)
        late = position - first
        np.add.at(grid, (first, pixel), polarity * (1.0 - late))
        np.add.at(grid, (np.minimum(first + 1, bins - 1), pixel), polarity * late)
    return grid.reshape(bins, height, width).astype(np.float32)


def normalised(grid: F32) -> F32:
    """The grid with a mean of 0 and a deviation of 1 over its entries that are not 0."""
    filled = grid != 0.0
    if not filled.any():
        return grid
    entries = grid[filled].astype(np.float64)
    deviation = max(float(entries.std()), LEAST_DEVIATION)
    found = np.zeros_like(grid)
    found[filled] = (entries - entries.mean()) / deviation
    return found
