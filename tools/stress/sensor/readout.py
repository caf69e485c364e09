"""More events than a chip can read out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from evs.msgs import Events
from evs.tools.stress.step_target import OPEN, SHUT, capture_step, edge_position
from evs.tools.stress.stress_case import Measurement, StressCase

READOUT = {
    "order": "arbiter", "row_ns": 500, "column_ns": 83, "jitter_ns": 50.0,
    "bandwidth_mevs": 12.0, "fifo": 8192, "stamp": "read",
}  # fmt: skip
"""[sensor.readout]: a DAVIS346's, its queue short enough to overflow soon"""


def _saturated(short: bool) -> Measurement:
    """All pixels black and white in turn, tick by tick, then one calm sweep."""
    flashes, calm = (20, 10) if short else (200, 40)
    rest = flashes + 12

    def left(tick: int) -> float:
        if tick < flashes:
            return SHUT if tick % 2 else OPEN
        return edge_position(rest, calm, tick)

    ticks = rest + 2 * calm + 4
    ideal = capture_step(left, ticks)
    chip = capture_step(left, ticks, {"sensor": {"readout": READOUT}})
    report = chip.capture.report
    made, out = len(ideal.capture.events), len(chip.capture.events)
    lost = report.events_dropped
    missing = abs(made - out - lost - report.events_waiting)
    # no more leaves in a millisecond than the link carries
    ends = np.arange(0, ticks * 1000 + 1, 1000)
    busiest = int(np.diff(np.searchsorted(chip.capture.events["t"], ends, "right")).max())
    dropped = report.cameras[0]["events_dropped"]
    messages = (f"{made:,} events made, {out:,} read out, dropped: {_causes(dropped)}",)
    calm_us = rest * 1000
    after, expected = (capture.within(calm_us, 10**9) for capture in (ideal.capture, chip.capture))
    right = lost > 0 and busiest <= 12_001 and _same_pixels(after, expected)
    return Measurement(missing, 0, "missing events", messages, right)


def _causes(dropped: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {cause}" for cause, count in dropped.items() if count)


def _same_pixels(a: Events, b: Events) -> bool:
    """Whether both have as many events of each pixel and polarity, and some."""
    sorted_a, sorted_b = (np.sort(events[["y", "x", "p"]]) for events in (a, b))
    return len(a) > 0 and bool(np.array_equal(sorted_a, sorted_b))


CASES = (
    StressCase(
        "every-pixel-every-tick",
        "sensor",
        "the whole picture black and white in turn, tick by tick, through a DAVIS346's readout",
        "events made = read out + dropped (counted by cause) + waiting; no more than 12 Mev/s out; "
        "what comes afterwards is read out whole",
        _saturated,
    ),
)
