"""A page of sensors beside a recording: where the events are, and the pixels that differ most."""

from __future__ import annotations

import numpy as np

from evs.drivers.pictures.chart import RGB, Chart, Scale, Series, draw_charts
from evs.msgs.pictures import INK, U8
from evs_lab.fit.observed import F64
from evs_lab.realism.paired import count_map
from evs_lab.realism.replays import Replay, Replays

CHART_PX = (460, 360)
COLUMNS = 4
WORST = 4
"""pixels whose events are drawn over time"""

APART_PX = 8
"""of these pixels from each other, in x or in y"""

DRAWN = 3
"""sensors in the charts over time"""

COLOURS: tuple[RGB, ...] = ((INK, INK, INK), (200, 60, 50), (40, 110, 190), (90, 160, 60))


def replay_page(found: Replays) -> U8:
    """(height, width, 3): a map for each sensor, then the worst pixels of the first one."""
    shown = [row for row in found.rows if len(row.events)]
    counts = [_map_of(found, row) for row in shown]
    top = max(float(np.nanquantile(counts[0], 0.999)), 2.0)
    charts = [
        Chart(f"{row.name}: {row.like.events:,} events", Scale(0.0, 1.0), Scale(0.0, top),
              "events of a pixel", picture=each, colours="Greys")
        for row, each in zip(shown, counts, strict=True)
    ]  # fmt: skip
    charts += [_course(found, shown[: DRAWN + 1], x, y) for x, y in _worst(counts[0], counts[1])]
    heading = f"{found.seen.source} beside sensors in the light of its frames, second half"
    about = f"below: ON less OFF events of the {WORST} pixels where {shown[1].name} is worst"
    return draw_charts(charts, COLUMNS, CHART_PX, heading, about)


def _map_of(found: Replays, row: Replay) -> F64:
    """(height, width) events of each pixel; NaN: it is not compared."""
    region = found.region
    out: F64 = np.full(region.pixels.shape, np.nan)
    out[region.pixels] = count_map(region.cut(row.events), region)
    return out


def _worst(real: F64, other: F64) -> list[tuple[int, int]]:
    """(x, y) of the pixels whose counts differ most, apart from each other."""
    found: list[tuple[int, int]] = []
    apart = np.nan_to_num(np.abs(other - real), nan=-1.0)
    for place in np.argsort(-apart, axis=None, kind="stable"):
        y, x = np.unravel_index(place, apart.shape)
        if all(max(abs(x - a), abs(y - b)) >= APART_PX for a, b in found):
            found.append((int(x), int(y)))
            if len(found) == WORST:
                break
    return found


def _course(found: Replays, rows: list[Replay], x: int, y: int) -> Chart:
    """ON less OFF events of a pixel over time."""
    region = found.region
    series, low, high = [], -1.0, 1.0
    seconds = 1e-6 * (region.end_us - region.begin_us)
    for row, colour in zip(rows, COLOURS, strict=False):
        events = region.cut(row.events)
        own = events[(events["x"] == x) & (events["y"] == y)]
        late = 1e-6 * (own["t"].astype(np.float64) - region.begin_us)
        level = np.cumsum(np.where(own["p"] == 1, 1.0, -1.0))
        # a stair: each event is a step
        time = np.append(np.append(0.0, np.repeat(late, 2)), seconds)
        steps = np.append(np.repeat(np.append(0.0, level), 2), [])
        low, high = min(low, float(steps.min())), max(high, float(steps.max()))
        series.append(Series(time.tolist(), steps.tolist(), colour, row.name, line=True))
    return Chart(f"pixel {x}, {y}", Scale(0.0, seconds, False, "s"),
                 Scale(low - 0.5, high + 0.5), "ON less OFF events", series)  # fmt: skip
