"""Chart of a scene: real-time factor against error, with the Pareto front and other methods."""

from __future__ import annotations

import math
from collections.abc import Sequence

from evs.drivers.pictures.chart import GREY, INK_RGB, RGB, Chart, Scale, Series, draw_charts
from evs.drivers.run.config import PRESETS
from evs.msgs.pictures import U8
from evs_lab.sweep.pareto_front import (
    DEFAULT,
    ErrorMetric,
    ParetoPoint,
    cases,
    pareto_front,
    pareto_points,
)
from evs_lab.sweep.point_names import NamedSeries, write_names
from evs_lab.sweep.record import FRAMES, OURS, SweepRecord
from evs_lab.sweep.record import PAPER as PAPER_KIND

CHART_PX = (960, 620)
LONGEST_NAME = 60
"""letters of a scene in the heading"""

COLOURS: dict[str, RGB] = dict(
    zip(PRESETS, ((205, 105, 0), (0, 130, 95), (25, 95, 175), (125, 60, 165)), strict=True)
)
"""of each preset and of what lies around it"""

PEERS: dict[str, tuple[str, RGB, str]] = {
    FRAMES: ("s", (110, 110, 110), "frames first, then events"),
    PAPER_KIND: ("D", (190, 30, 60), "the paper's pipeline"),
}
"""kind -> mark, colour, words"""

PRESET_PX, FRONT_PX, PEER_PX, NEAR_PX = 120.0, 90.0, 80.0, 14.0
"""how far names may stand from presets, the front, peers and all others; the first find room first
"""


def pareto_page(records: Sequence[SweepRecord], metric: ErrorMetric = DEFAULT) -> U8:
    """Draw a chart for each camera motion of one scene.

    Args:
        records: of one scene; those without a speed or an error are not shown.
        metric: of the error.

    Returns:
        (height, width, 3) uint8 image.
    """
    scene = records[0].scene if records else ""
    shown = [pareto_chart(subset, metric) for subset in cases(records).values()]
    # of a path that is too long for the page, its end
    name = scene if len(scene) <= LONGEST_NAME else f"...{scene[-LONGEST_NAME:]}"
    return draw_charts(
        shown, 1, CHART_PX, f"Speed against error: {name}", legend(metric),
        lambda axes, index: write_names(axes, shown[index]),
    )  # fmt: skip


def legend(metric: ErrorMetric = DEFAULT) -> str:
    """What line, bars and height are."""
    return f"error: {metric.label}; line: the front; bars: 95 % interval over repeats"


def pareto_chart(records: Sequence[SweepRecord], metric: ErrorMetric = DEFAULT) -> Chart:
    """What one panel shows.

    Args:
        records: of one scene under one camera motion.
        metric: the error metric.
    """
    every = pareto_points(records, metric)
    best = pareto_front(every)
    camera = records[0].camera if records else ""
    reference_error = _reference_errors(records, metric)
    low, high = steps_around([p.error for p in every] + reference_error[:1])
    slow, fast = steps_around([p.speed for p in every])
    y = Scale(low, high, log=True)
    # what is no error at all has no place on a logarithm: it stands on the axis
    heights = {id(p): max(p.error, low) for p in every}
    series = [
        Series([p.speed for p in best], [heights[id(p)] for p in best], INK_RGB, line=True),
        *_peers(every, heights),
        *_ours(every, best, heights),
    ]
    marks = [(o, "the reference's own error") for o in reference_error[:1] if low <= o <= high]
    return Chart(
        f"camera {camera}",
        Scale(slow, fast, log=True),
        y,
        "real-time factor: simulated seconds per second",
        series,
        marks=marks,
        posts=[(1.0, "real time")] if slow < 1.0 < fast else [],
        empty="" if every else "nothing was measured, or nothing happens",
    )


def _reference_errors(records: Sequence[SweepRecord], metric: ErrorMetric) -> list[float]:
    found = [metric.reference_error(r.error) for r in records if r.error is not None]
    return [value for value in found if math.isfinite(value)]


def _ours(
    every: Sequence[ParetoPoint], best: Sequence[ParetoPoint], heights: dict[int, float]
) -> list[NamedSeries]:
    """Presets over the front over all others; their names find room in that order too."""
    ours = [p for p in every if p.record.kind == OURS]
    marked = {id(p) for p in best}
    presets = [p for p in ours if not p.record.axis]
    on = [p for p in ours if p.record.axis and id(p) in marked]
    off = [p for p in ours if p.record.axis and id(p) not in marked]
    names = dict.fromkeys(p.record.preset for p in ours)
    found = []
    for mark, reach, some in (
        ("circle", NEAR_PX, off),
        ("o", FRONT_PX, on),
        ("^", PRESET_PX, presets),
    ):
        for name in names:
            subset = [p for p in some if p.record.preset == name]
            label = name if some is presets else ""
            found.append(_series(subset, heights, _colour(name), mark, reach, label))
    return found


def _peers(every: Sequence[ParetoPoint], heights: dict[int, float]) -> list[NamedSeries]:
    found = []
    for kind, (mark, colour, words) in PEERS.items():
        subset = [p for p in every if p.record.kind == kind]
        label = words if subset else ""
        found.append(_series(subset, heights, colour, mark, PEER_PX, label=label))
    return found


def _series(
    some: Sequence[ParetoPoint],
    heights: dict[int, float],
    colour: RGB,
    mark: str,
    reach_px: float,
    label: str = "",
) -> NamedSeries:
    speeds = [p.record.speed for p in some]
    return NamedSeries(
        [p.speed for p in some],
        [heights[id(p)] for p in some],
        colour,
        label,
        mark=mark,
        x_range=[(s.real_time_factor.low, s.real_time_factor.high) for s in speeds if s],
        names=[p.record.value or p.record.preset for p in some],
        reach_px=reach_px,
    )


def _colour(preset: str) -> RGB:
    return COLOURS.get(preset, GREY)


def steps_around(values: list[float]) -> tuple[float, float]:
    """(low, high): 1, 2 or 5 times powers of ten around the positive ones, with a margin.

    At least a factor of 10 apart.
    """
    good = [value for value in values if math.isfinite(value) and value > 0.0]
    if not good:
        return 0.1, 10.0
    below, above = min(good) / 1.15, max(good) * 1.15
    first, last = math.floor(math.log10(below)), math.ceil(math.log10(above))
    steps = [m * 10.0**e for e in range(first - 1, last + 2) for m in (1.0, 2.0, 5.0)]
    low = max(step for step in steps if step <= below)
    return low, min(step for step in steps if step >= max(above, 9.99 * low))
