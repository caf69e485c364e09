"""Ticks of any length see the same motion."""

from __future__ import annotations

from evs.tools.stress.moving_edge import capture_edge, is_explained, worst_share
from evs.tools.stress.stress_case import Measurement, StressCase

TICKS_US = (10, 100, 1000, 10_000, 100_000)
SPEED_PX_S = 100.0


def _ticks(short: bool) -> Measurement:
    worst, recovered, messages = 0.0, True, []
    for tick_us in TICKS_US:
        width_px = 1 if short and tick_us == 10 else 4
        seen = capture_edge(SPEED_PX_S, tick_us, width_px)
        share = worst_share(seen, SPEED_PX_S, tick_us, width_px)
        worst, recovered = max(worst, share), recovered and is_explained(seen)
        messages.append(f"ticks of {tick_us} us: {share:.2f}")
        messages += seen.warnings
    return Measurement(worst, 1.0, "of the bound", tuple(messages), recovered)


CASES = (
    StressCase(
        "tick-lengths",
        "time",
        "an edge at 100 px/s in ticks of 10 us, 100 us, 1 ms, 10 ms and 100 ms",
        "the same 8 events of each pixel, each within a tick and a 64th of a pixel's passage of "
        "its time in closed form",
        _ticks,
    ),
)
