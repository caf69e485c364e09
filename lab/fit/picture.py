"""A page that shows each recording beside another, or the same light on a sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evs.drivers.pictures.chart import RGB, Chart, Scale, Series, draw_charts
from evs.msgs.pictures import OFF_RGB, ON_RGB, PAPER, U8
from evs_lab.fit.observed import F64, Observed

CHART_PX = (500, 380)
PALE = 0.5
"""how far the colour of the lines is from that of the points, towards paper"""

PAIRS = ((True, True), (False, False), (True, False), (False, True))
PAIR_RGB: tuple[RGB, ...] = (ON_RGB, OFF_RGB, (150, 80, 190), (225, 130, 0))


def page(pairs: Sequence[tuple[Observed, Observed | None, str]], heading: str) -> U8:
    """(height, width, 3): intervals, rates of pixels and maps; a row for each pair.

    Args:
        pairs: A recording (points), what is compared with it (lines; None: it is not known), and
            the name of that.
        heading: Of the page.
    """
    charts = [
        chart
        for seen, beside, name in pairs
        for chart in (
            _intervals(seen, beside),
            _rates(seen, beside, name),
            event_map(seen, seen, seen.source),
            event_map(beside, seen, name),
        )
    ]
    return draw_charts(charts, 4, CHART_PX, heading)


def _pale(colour: RGB) -> RGB:
    r, g, b = (round(part + PALE * (PAPER - part)) for part in colour)
    return r, g, b


def _intervals(seen: Observed, beside: Observed | None) -> Chart:
    """Density of the intervals between events of a pixel, by their polarities."""
    edges = np.geomspace(1.0, 1e8, 65)
    series, tops = [], [1e-6]
    for (before, after), colour in zip(PAIRS, PAIR_RGB, strict=True):
        words = f"{'ON' if before else 'OFF'} to {'ON' if after else 'OFF'}"
        for one, line in ((beside, True), (seen, False)):
            if one is None:
                continue
            every = one.intervals
            chosen = (every.before_on == before) & (every.after_on == after)
            # of a pixel and second
            counts = (
                np.histogram(every.length_us[chosen] + 0.5, edges)[0] / one.pixels / one.seconds
            )
            held = counts > 0
            middle = np.sqrt(edges[1:] * edges[:-1]) * 1e-6
            tops.append(float(counts.max(initial=0.0)))
            series.append(
                Series(middle[held].tolist(), counts[held].tolist(),
                       _pale(colour) if line else colour, "" if line else words, line=line)
            )  # fmt: skip
    top = max(tops)
    return Chart("Intervals of a pixel, per pixel and second", Scale(1e-6, 100.0, True, "s"),
                 Scale(top * 1e-5, top * 3.0, True), "between two of its events", series,
                 empty="" if len(series) else "no intervals")  # fmt: skip


def _rates(seen: Observed, beside: Observed | None, name: str) -> Chart:
    """Share of the pixels over a rate, ON and OFF."""
    series = []
    highest = 1.0
    for key, colour in (("on_counts", ON_RGB), ("off_counts", OFF_RGB)):
        for one, line in ((beside, True), (seen, False)):
            if one is None:
                continue
            rates: F64 = np.sort(getattr(one, key) / one.seconds)
            silent = int(np.count_nonzero(rates == 0.0))
            if silent == len(rates):
                continue
            places = np.unique(np.linspace(silent, len(rates) - 1, 40).round().astype(np.int64))
            share = 100.0 * (1.0 - places / len(rates))
            highest = max(highest, float(rates[-1]))
            words = "" if line else f"{key[: key.index('_')].upper()} {rates.mean():.3g} Hz"
            values = rates[places]
            series.append(Series(values.tolist(), share.tolist(), _pale(colour) if line else colour,
                                 words, line=line))  # fmt: skip
    if beside is not None:
        on, off = (float(c.mean()) / beside.seconds for c in (beside.on_counts, beside.off_counts))
        label = f"rate; {name}: ON {on:.3g} Hz, OFF {off:.3g} Hz"
    else:
        label = "rate"
    axis = Scale(0.7 / seen.seconds, 1.3 * highest, True, "Hz")
    return Chart("Pixels with more than a rate, %", axis, Scale(0.0, 105.0), label, series)


def event_map(one: Observed | None, scale: Observed, title: str) -> Chart:
    """Events of each pixel, dark for many, by the recording's own scale."""
    nothing = Scale(0.0, 1.0)
    if one is None:
        return Chart(title, nothing, nothing, "", empty="its light is not known")
    # a map of some thousand cells, so that single pixels show
    rate = (one.on_counts + one.off_counts).reshape(one.height, one.width) / one.seconds
    own = (scale.on_counts + scale.off_counts) / scale.seconds
    low = max(float(np.quantile(own, 0.05)), 0.3 / scale.seconds)
    high = max(float(np.quantile(own, 0.999)), 3.0 * low)
    axis = Scale(low, high, True, "Hz")
    return Chart(title, nothing, axis, "events of a pixel",
                 picture=np.maximum(rate, low), colours="Greys")  # fmt: skip
