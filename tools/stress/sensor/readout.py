"""More events than a chip can read out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from evs.msgs import Events
from evs.tools.stress.extreme import Extreme, Outcome
from evs.tools.stress.step_target import OPEN, SHUT, curtain, swept

READOUT = {
    "order": "arbiter", "row_ns": 500, "column_ns": 83, "jitter_ns": 50.0,
    "bandwidth_mevs": 12.0, "fifo": 8192, "stamp": "read",
}  # fmt: skip
"""[sensor.readout]: a DAVIS346's, its queue short enough to overflow soon"""


def _saturated(short: bool) -> Outcome:
    """All pixels black and white in turn, tick by tick, then one calm sweep."""
    flashes, calm = (20, 10) if short else (200, 40)
    rest = flashes + 12

    def left(tick: int) -> float:
        if tick < flashes:
            return SHUT if tick % 2 else OPEN
        return swept(rest, calm, tick)

    ticks = rest + 2 * calm + 4
    ideal = curtain(left, ticks)
    chip = curtain(left, ticks, {"sensor": {"readout": READOUT}})
    report = chip.film.report
    made, out = len(ideal.film.events), len(chip.film.events)
    lost = report.events_dropped
    missing = abs(made - out - lost - report.events_waiting)
    # no more leaves in a millisecond than the link carries
    ends = np.arange(0, ticks * 1000 + 1, 1000)
    busiest = int(np.diff(np.searchsorted(chip.film.events["t"], ends, "right")).max())
    told = report.cameras[0]["events_dropped"]
    said = (f"{made:,} events made, {out:,} read out, dropped: {_causes(told)}",)
    calm_us = rest * 1000
    after, expected = (film.within(calm_us, 10**9) for film in (ideal.film, chip.film))
    right = lost > 0 and busiest <= 12_001 and _same_pixels(after, expected)
    return Outcome(missing, 0, "missing events", said, right)


def _causes(dropped: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {cause}" for cause, count in dropped.items() if count)


def _same_pixels(a: Events, b: Events) -> bool:
    """Whether both have as many events of each pixel and polarity, and some."""
    sorted_a, sorted_b = (np.sort(events[["y", "x", "p"]]) for events in (a, b))
    return len(a) > 0 and bool(np.array_equal(sorted_a, sorted_b))


EXTREMES = (
    Extreme(
        "every-pixel-every-tick",
        "sensor",
        "the whole picture black and white in turn, tick by tick, through a DAVIS346's readout",
        "events made = read out + dropped (counted by cause) + waiting; no more than 12 Mev/s out; "
        "what comes afterwards is read out whole",
        _saturated,
    ),
)
