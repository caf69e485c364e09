"""The curve of saved balls as a chart and as a table."""

from __future__ import annotations

import math
from typing import Any

from evs.drivers.pictures import U8
from evs.drivers.pictures.chart import draw_chart
from evs.drivers.pictures.chart_layout import Chart, Series
from evs.drivers.pictures.scales import Scale
from evs.examples.goalie import TRACKERS
from evs.examples.goalie.speed_curve import FASTEST_M_S, SLOWEST_M_S, half_speed

COLOURS = {"events": (0, 114, 255), "200 FPS": (30, 30, 30), "60 FPS": (200, 120, 0)}

HEADINGS = ("tracker", "half are saved up to, m/s", "saved of all shots, %")


def shares(row: dict[str, int], shots: int) -> dict[float, float]:
    """Speed -> share saved, by speed."""
    return {speed: row[f"{speed:g}"] / shots for speed in sorted(map(float, row))}


def chart(rows: dict[str, dict[str, Any]], shots: int) -> U8:
    """Share saved over speed, a line and its points a tracker, with the standard error."""
    series = []
    for tracker in [name for name in TRACKERS if name in rows]:
        known = shares(rows[tracker], shots)
        x, y = list(known), [100.0 * share for share in known.values()]
        error = [100.0 * math.sqrt(share * (1.0 - share) / shots) for share in known.values()]
        colour = COLOURS[tracker]
        series += [
            Series(x, y, colour, line=True),
            Series(x, y, colour, label=tracker, error=error),
        ]
    found = Chart(
        f"Balls saved, % of {shots} shots at each speed",
        Scale(SLOWEST_M_S, FASTEST_M_S, log=True, shown=(1, 2, 4, 8, 16, 32, 64)),
        Scale(0.0, 100.0),
        "speed of the ball, m/s",
        series,
    )
    return draw_chart(found, 760, 420)


def table_rows(rows: dict[str, dict[str, Any]], shots: int) -> list[tuple[str, ...]]:
    """A line a tracker."""
    rows_of_text = list[tuple[str, ...]]()
    for tracker in [name for name in TRACKERS if name in rows]:
        known = shares(rows[tracker], shots)
        half = half_speed(known)
        mean = 100.0 * sum(known.values()) / len(known)
        rows_of_text.append((tracker, "-" if half is None else f"{half:.3g}", f"{mean:.1f}"))
    return rows_of_text


def markdown(rows: dict[str, dict[str, Any]], shots: int, command: str) -> str:
    """The table, and how it was made."""
    lines = ["| " + " | ".join(HEADINGS) + " |", "|" + " --- |" * len(HEADINGS)]
    lines += ["| " + " | ".join(row) + " |" for row in table_rows(rows, shots)]
    return "\n".join([*lines, "", f"*`{command}`*", ""])
