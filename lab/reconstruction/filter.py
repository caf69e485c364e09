"""Pictures from events alone, without a model: the complementary filter's high pass.

The filter is that of Scheerlinck, Barnes and Mahony (ACCV 2018) without frames: each pixel adds its
threshold at every event and forgets exponentially. It has a closed form between events, so nothing
here is stepped in time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evs.emulator.base.scene import F64
from evs.msgs import Events

CUTOFF_RAD_S = 2 * np.pi
"""the authors' default for pictures without frames"""


def complementary_filter(
    events: Events,
    shape: tuple[int, int],
    times_us: Sequence[int],
    threshold: float,
    cutoff_rad_s: float = CUTOFF_RAD_S,
) -> F64:
    """Reconstruct log light from events; zero at 0 us.

    Args:
        events: in any order.
        shape: height and width, px.
        times_us: when to read the state, ascending.
        threshold: what an event is worth, log units.
        cutoff_rad_s: how fast a pixel forgets, 1/s.

    Returns:
        (times, height, width) log units.
    """
    height, width = shape
    order = np.argsort(events["t"], kind="stable")
    t, x, y, p = (events[name][order].astype(np.int64) for name in "txyp")
    pixel = y * width + x
    step = np.where(p == 1, threshold, -threshold)
    ends = np.searchsorted(t, times_us, "right")
    state, begin, before_us, read = np.zeros(height * width), 0, 0, []
    for now_us, end in zip(times_us, ends, strict=True):
        age_s = 1e-6 * (now_us - t[begin:end])
        state *= np.exp(-cutoff_rad_s * 1e-6 * (now_us - before_us))
        weight = step[begin:end] * np.exp(-cutoff_rad_s * age_s)
        state += np.bincount(pixel[begin:end], weight, height * width)
        begin, before_us = end, now_us
        read.append(state.reshape(shape).copy())
    return np.stack(read)
