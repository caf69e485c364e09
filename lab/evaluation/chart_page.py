"""One page of an evaluation: EMD and recall of every model against samples a pixel."""

from __future__ import annotations

import math
from collections.abc import Sequence

from evs.drivers.pictures.chart import RGB, Chart, Scale, Series, decades_around, draw_charts
from evs.msgs.pictures import U8
from evs_lab.evaluation.aggregate import ResultRow
from evs_lab.evaluation.claims import NOTHING, REFERENCE
from evs_lab.evaluation.table import Evaluation

CHART_PX = (640, 400)

COLOURS: dict[str, RGB] = {
    "plain": (130, 130, 130),
    "adaptive": (225, 130, 0),
    "paper": (150, 80, 190),
    "evsnet_c8": (30, 100, 170),
    "evsnet_c4": (0, 140, 100),
}
OTHERS: tuple[RGB, ...] = ((190, 40, 60), (90, 60, 20), (0, 150, 170), (200, 60, 150))
"""of models without a colour of their own"""


def evaluation_page(found: Evaluation) -> U8:
    """(height, width, 3): a row for each camera and way to sample, EMD left, recall right."""
    rows = found.rows
    paths = [row for row in rows if row.light == "path"]
    cases = list(dict.fromkeys((row.camera, row.seeds) for row in paths))
    colours = _colours([row.model for row in paths])
    charts = [
        chart
        for camera, seeds in cases
        for chart in (
            _emd(rows, camera, seeds, colours),
            _recall(rows, camera, seeds, colours),
        )
    ]
    scenes = len(dict.fromkeys(clip.scene for clip in found.clips))
    description = (
        f"{scenes} scene{'s' if scenes > 1 else ''}: mean, bars: standard deviation; "
        f"against events of {found.settings.get('reference_spp')} samples per pixel"
    )
    return draw_charts(charts, 2, CHART_PX, "Event models on light of few samples", description)


def _colours(models: Sequence[str]) -> dict[str, RGB]:
    names = list(dict.fromkeys(models))
    others = [name for name in names if name not in COLOURS]
    own = {name: OTHERS[k % len(OTHERS)] for k, name in enumerate(others)}
    return {name: COLOURS.get(name) or own[name] for name in names}


def _series(
    rows: Sequence[ResultRow],
    camera: str,
    seeds: str,
    value: str,
    colours: dict[str, RGB],
    spread: bool,
) -> list[Series]:
    """A line and points for each model, over samples a pixel."""
    series = []
    for model, colour in colours.items():
        subset = [
            r for r in rows
            if (r.camera, r.light, r.seeds, r.model) == (camera, "path", seeds, model)
        ]  # fmt: skip
        subset.sort(key=lambda row: row.spp)
        x = [float(row.spp) for row in subset]
        y = [row.values[value].mean for row in subset]
        error = [row.values[value].spread for row in subset] if spread else []
        series.append(Series(x, y, colour, line=True))
        series.append(Series(x, y, colour, model, error=error))
    return series


def _x(rows: Sequence[ResultRow]) -> Scale:
    spp = sorted({float(row.spp) for row in rows if row.light == "path"})
    return Scale(spp[0] / 1.5, spp[-1] * 1.5, log=True, shown=tuple(spp))


def _emd(rows: Sequence[ResultRow], camera: str, seeds: str, colours: dict[str, RGB]) -> Chart:
    series = _series(rows, camera, seeds, "emd", colours, spread=False)
    marks = [
        (row.values["emd"].mean, description)
        for name, description in (
            (NOTHING, "no event at all"),
            (REFERENCE, "the halves of the reference"),
        )
        for row in rows
        if (row.camera, row.model) == (camera, name) and row.values["emd"].mean > 0.0
    ]
    seen = [y for one in series for y in one.y] + [level for level, _ in marks]
    low, high = decades_around(seen)
    title = f"EMD, events per pixel: camera {camera}, {seeds} samples"
    return Chart(title, _x(rows), Scale(low, high, log=True), "samples per pixel", series, marks)


def _recall(rows: Sequence[ResultRow], camera: str, seeds: str, colours: dict[str, RGB]) -> Chart:
    series = _series(rows, camera, seeds, "recall", colours, spread=True)
    title = f"Recall, 3 ms: camera {camera}, {seeds} samples"
    some = any(math.isfinite(y) for one in series for y in one.y)
    return Chart(
        title,
        _x(rows),
        Scale(0.0, 1.0),
        "samples per pixel",
        series,
        empty="" if some else "nothing happens",
    )
