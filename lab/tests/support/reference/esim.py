"""ESIM's pixel, written from its paper (Rebecq, Gehrig, Scaramuzza, CoRL 2018), in plain NumPy.

Log light is a straight line from frame to frame; an event at each level of it that lies a whole
threshold beyond the last one. Thresholds spread over pixels; there is no noise and no dead time.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

LOG_EPS = 1e-3
"""ESIM's default: ln(light + this), where 1 is white"""

EVENT = np.dtype([("t", np.int64), ("x", np.uint16), ("y", np.uint16), ("p", np.uint8)])


def esim(
    frames: Iterable[npt.NDArray[Any]], tick_us: int, threshold: float, spread: float, seed: int
) -> npt.NDArray[np.void]:
    """Emulate a film.

    Args:
        frames: (h, w) linear light, white is 1; the first one is at 0 us.
        tick_us: Between two frames.
        threshold: Mean of both thresholds, log units.
        spread: Standard deviation of both over pixels, log units.
        seed: Of the thresholds.

    Returns:
        Fields t (us), x, y, p (1: ON), sorted by time.
    """
    logs = (np.log(frame.astype(np.float64) + LOG_EPS) for frame in frames)
    last = next(logs)
    random = np.random.default_rng(seed)
    steps = np.maximum(random.normal(threshold, spread, (2, *last.shape)), 0.01)
    level = last.copy()
    parts: list[tuple[npt.NDArray[Any], ...]] = [tuple(np.empty(0) for _ in "txyp")]
    for k, log in enumerate(logs):
        for p, sign in ((1, 1.0), (0, -1.0)):
            found = np.nonzero((log - level) * sign >= steps[p])
            while len(found[0]):
                level[found] += sign * steps[p][found]
                share = (level[found] - last[found]) / (log[found] - last[found])
                t = np.rint(tick_us * (k + share))
                parts.append((t, found[1], found[0], np.full(len(t), p)))
                more = (log[found] - level[found]) * sign >= steps[p][found]
                found = found[0][more], found[1][more]
        last = log
    t, x, y, polarity = (np.concatenate(column) for column in zip(*parts, strict=True))
    events = np.empty(len(t), EVENT)
    events["t"], events["x"], events["y"], events["p"] = t, x, y, polarity
    return np.asarray(events[np.argsort(t, kind="stable")])
