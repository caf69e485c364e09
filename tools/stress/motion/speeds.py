"""An edge that crawls, and one that jumps over the picture."""

from __future__ import annotations

from evs.tools.stress.grid_target import HEIGHT_PX
from evs.tools.stress.moving_edge import EVENTS, capture_edge, is_explained, worst_share
from evs.tools.stress.stress_case import Measurement, StressCase

SPEEDS = (
    (1e-6, 250_000_000, 1),
    (1e-3, 10_000_000, 4),
    (1.0, 10_000, 4),
    (1e3, 10, 4),
    (1e3, 1000, 32),
    (1e6, 10, 32),
    (1e6, 1000, 32),
)
"""px/s, ticks of so many us, width of the picture: a pixel at 1e-6 px/s takes 11.6 days"""


def _speeds(short: bool) -> Measurement:
    worst, recovered, messages = 0.0, True, []
    for speed_px_s, tick_us, width_px in SPEEDS[2:] if short else SPEEDS:
        seen = capture_edge(speed_px_s, tick_us, width_px)
        share = worst_share(seen, speed_px_s, tick_us, width_px)
        worst, recovered = max(worst, share), recovered and is_explained(seen)
        rate = EVENTS * HEIGHT_PX * speed_px_s
        messages.append(
            f"{speed_px_s:g} px/s in ticks of {tick_us} us: {rate:g} events/s, {share:.2f}"
        )
        messages += seen.warnings
    return Measurement(worst, 1.0, "of the bound", tuple(messages), recovered)


CASES = (
    StressCase(
        "speeds",
        "motion",
        "an edge at 1e-6, 1e-3, 1, 1e3 and 1e6 px/s, ticks of 10 us ... 250 s",
        "floor(ln(bright / dim) / threshold) = 8 events of each pixel, each within a tick and a "
        "64th of a pixel's passage of its time in closed form",
        _speeds,
    ),
)
