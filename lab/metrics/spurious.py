"""Events without a partner in the reference, per pixel and second."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import Events, EvsError
from evs_lab.metrics.counts import count_map
from evs_lab.metrics.matching import Matching
from evs_lab.metrics.window import Window, whole_number

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Spurious:
    """Unmatched events and where they are."""

    events: int
    """unmatched events"""
    rate_hz: float
    """unmatched events per pixel of the window and second"""
    static_px: int
    """number of static pixels"""
    static_events: int
    """unmatched events on static pixels"""
    static_rate_hz: float
    """unmatched events on static pixels, per static pixel and second; NaN if no pixel is static"""


def measure_spurious(events: Events, matching: Matching, window: Window, static: Mask) -> Spurious:
    """Rates of unmatched events.

    Args:
        events: (n,) EVENT_DTYPE inside the window (`window.cut`), those that were matched
        matching: of these events
        window: pixels and time
        static: (height, width) bool, True where nothing should happen (`static_pixels`)

    Raises:
        EvsError: static has another shape or dtype
    """
    if static.shape != (window.height, window.width) or static.dtype != np.bool_:
        raise EvsError(
            f"static pixels are {static.dtype} {static.shape}; "
            f"give bool {(window.height, window.width)}"
        )
    counts = count_map(events[matching.unmatched()], window)
    total, on_static = int(counts.sum()), int(counts[static].sum())
    static_px = int(np.count_nonzero(static))
    return Spurious(
        events=total,
        rate_hz=total / (window.pixels * window.duration_s),
        static_px=static_px,
        static_events=on_static,
        static_rate_hz=(on_static / (static_px * window.duration_s) if static_px else float("nan")),
    )


def static_pixels(reference: Events, window: Window, margin_px: int = 1) -> Mask:
    """Pixels around which the reference has no event in the window.

    With margin_px = tolerance_px, no event on such a pixel can have a partner, and events that are
    one pixel off an edge do not count as static.

    Args:
        reference: (m,) EVENT_DTYPE inside the window (`window.cut`)
        window: pixels and time
        margin_px: silent in this distance too, px in x and in y (Chebyshev)

    Returns:
        (height, width) bool
    """
    margin_px = whole_number("margin_px", margin_px, lowest=0)
    busy = count_map(reference, window) > 0
    # a square is wide in x and wide in y: two passes
    for axis, side in ((0, window.height), (1, window.width)):
        grown = busy.copy()
        for shift in range(1, min(margin_px, side - 1) + 1):
            near, far = _ends(axis, shift)
            grown[far] |= busy[near]
            grown[near] |= busy[far]
        busy = grown
    return ~busy


def _ends(axis: int, shift: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """All but the last, and all but the first, `shift` lines along an axis of a map."""
    every = slice(None)
    near, far = slice(None, -shift), slice(shift, None)
    return ((near, every), (far, every)) if axis == 0 else ((every, near), (every, far))
