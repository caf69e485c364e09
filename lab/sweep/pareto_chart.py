"""Chart of a scene: real-time factor against error, with the Pareto front and other methods."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evs.drivers.pictures.chart import draw_chart
from evs.drivers.pictures.chart_layout import Chart, Series
from evs.drivers.pictures.pen import GREY, INK_RGB, RGB
from evs.drivers.pictures.scales import Scale, steps_around
from evs.drivers.pictures.text_lines import TextLine, paste, text_line
from evs.drivers.run.config import PRESETS
from evs.msgs.pictures import PAPER, U8
from evs_lab.sweep.pareto_front import (
    DEFAULT,
    ErrorMetric,
    ParetoPoint,
    cases,
    pareto_front,
    pareto_points,
)
from evs_lab.sweep.record import FRAMES, OURS, SweepRecord
from evs_lab.sweep.record import PAPER as PAPER_KIND

CHART_PX = (960, 620)
MARGIN_PX = 22

COLOURS: dict[str, RGB] = dict(
    zip(PRESETS, ((205, 105, 0), (0, 130, 95), (25, 95, 175), (125, 60, 165)), strict=True)
)
"""of each preset and of what lies around it"""

PEERS: dict[str, tuple[str, RGB, str]] = {
    FRAMES: ("square", (110, 110, 110), "frames first, then events"),
    PAPER_KIND: ("diamond", (190, 30, 60), "the paper's way"),
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
    heading = _heading(scene, CHART_PX[0])
    subtitle = text_line(legend(metric), 16)
    top = MARGIN_PX + heading.height + subtitle.height + 10
    width, height = CHART_PX
    page = np.full(
        (top + height * len(shown) + MARGIN_PX, width + 2 * MARGIN_PX, 3), PAPER, np.uint8
    )
    paste(page, heading.picture, MARGIN_PX + 18, MARGIN_PX)
    paste(page, subtitle.picture, MARGIN_PX + 18, MARGIN_PX + heading.height)
    for k, chart in enumerate(shown):
        paste(page, draw_chart(chart, width, height), MARGIN_PX, top + k * height)
    return page


def _heading(scene: str, width: int) -> TextLine:
    """The heading with the scene's name; of a path that is too long for the page, its end."""
    line, cut = text_line(f"Speed against error: {scene}", 28), 0
    while line.picture.shape[1] > width and cut < len(scene):
        cut += 1
        line = text_line(f"Speed against error: ...{scene[cut:]}", 28)
    return line


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
) -> list[Series]:
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
        ("disc", FRONT_PX, on),
        ("triangle", PRESET_PX, presets),
    ):
        for name in names:
            subset = [p for p in some if p.record.preset == name]
            label = name if some is presets else ""
            found.append(_series(subset, heights, _colour(name), mark, reach, label))
    return found


def _peers(every: Sequence[ParetoPoint], heights: dict[int, float]) -> list[Series]:
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
) -> Series:
    speeds = [p.record.speed for p in some]
    return Series(
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
