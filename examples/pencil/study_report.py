"""The table of the study, in Markdown and for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

HEADINGS = (
    "tracker",
    "shortest stick, mm",
    "strongest push, mN s",
    "longest delay, ms",
    "stood to the end",
    "gains (fast, slow, observer Hz, lag ms)",
)


def table_rows(rows: dict[str, dict[str, Any]], trackers: Sequence[str]) -> list[tuple[str, ...]]:
    """What is known of each tracker; "-": not found out, "none": not even the easiest."""
    return [(tracker, *_cells(rows.get(tracker, {}))) for tracker in trackers]


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    stood = row.get("stood")
    gains = row.get("gains", {}).get("found")
    return (
        _number(row, "shortest_m", 1e3),
        _number(row, "strongest_mns"),
        _number(row, "longest_ms"),
        "-" if stood is None else f"{stood['stood']} of {stood['starts']}",
        "-" if gains is None else ", ".join(f"{value:.3g}" for value in gains.values()),
    )


def _number(row: dict[str, Any], name: str, unit: float = 1.0) -> str:
    if name not in row:
        return "-"
    value = row[name]
    return "none" if value is None else f"{value * unit:.3g}"


def markdown(rows: dict[str, dict[str, Any]], trackers: Sequence[str], command: str) -> str:
    """The table, and how it was made."""
    lines = ["| " + " | ".join(HEADINGS) + " |", "|" + " --- |" * len(HEADINGS)]
    lines += ["| " + " | ".join(row) + " |" for row in table_rows(rows, trackers)]
    return "\n".join([*lines, "", f"*`{command}`*", ""])
