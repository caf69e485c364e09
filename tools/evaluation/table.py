"""An evaluation in words: one table in Markdown, everything in JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from evs.tools.evaluation.check import Check
from evs.tools.evaluation.pool import Cell, Row, Value, rows_of
from evs.tools.evaluation.verdict import NOTHING, REFERENCE, Claim, verdict, winners


@dataclass(frozen=True)
class Column:
    """One value of a row in the Markdown table."""

    heading: str
    value: str
    """its name in pool.VALUES"""
    form: str
    """of the number"""
    scale: float = 1.0


COLUMNS = (
    Column("EMD", "emd", ".3f"),
    Column("ON", "count_on", ".2f"),
    Column("OFF", "count_off", ".2f"),
    Column("static Hz", "static_hz", ".3g"),
    Column("spurious Hz", "spurious_hz", ".3g"),
    Column("recall", "recall", ".2f"),
    Column("precision", "precision", ".2f"),
    Column("patch recall", "patch_recall", ".2f"),
    Column("patch precision", "patch_precision", ".2f"),
    Column("delay ms", "delay_us", ".2f", 1e-3),
    Column("timing ms", "timing_us", ".2f", 1e-3),
    Column("RMSE Hz", "rmse_hz", ".3g"),
    Column("KL", "kl_nats", ".3f"),
    Column("corr.", "correlation", ".3f"),
    Column("ms a tick", "ms_per_tick", ".2f"),
)


@dataclass(frozen=True)
class TakeFacts:
    """What one take was."""

    scene: str
    camera: str
    soft: bool
    pixels: int
    static_px: int
    """of them whose converged light stands still"""
    patch: tuple[int, int, int]
    """column, row, side, px"""
    reference_events: int
    """on the pixels that are spread over the picture"""
    reference_patch_events: int


@dataclass(frozen=True)
class Evaluation:
    """Everything that was measured."""

    command: str
    """the command line that made it"""
    settings: dict[str, Any]
    versions: dict[str, str]
    takes: list[TakeFacts] = field(default_factory=list)
    cells: list[Cell] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    """a line for each model that is not there"""
    check: Check | None = None
    """of a user's own network"""

    @property
    def rows(self) -> list[Row]:
        """The table: all scenes of one camera motion together."""
        return rows_of(self.cells)

    @property
    def verdict(self) -> list[Claim]:
        """What became of each claim."""
        return verdict(self.cells)

    def plain(self) -> dict[str, Any]:
        """Nested dicts and lists, strict JSON: None where a value is not defined."""
        plain: dict[str, Any] = finite(
            {
                "command": self.command,
                "settings": self.settings,
                "versions": self.versions,
                "left_out": self.left_out,
                "check": None if self.check is None else asdict(self.check),
                "takes": [asdict(take) for take in self.takes],
                "rows": [_row(row) for row in self.rows],
                "verdict": [asdict(claim) for claim in self.verdict],
                "winners": winners(self.cells),
                "cells": [asdict(cell) for cell in self.cells],
            }
        )
        return plain

    def to_json(self) -> str:
        """Indented text."""
        return json.dumps(self.plain(), indent=1, allow_nan=False) + "\n"


def _row(row: Row) -> dict[str, Any]:
    told = asdict(row)
    for name, value in told.pop("values").items():
        told[name], told[f"{name}_spread"] = value["mean"], value["spread"]
    return told


def finite(value: Any) -> Any:
    """The same without NaN and infinity: None."""
    if isinstance(value, dict):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def markdown(found: Evaluation) -> str:
    """The command, the table and the verdict."""
    scenes = list(dict.fromkeys(take.scene for take in found.takes))
    lines = [
        f"    {found.command}",
        "",
        f"{len(scenes)} scenes: {', '.join(scenes)}. Mean of all scenes ± standard deviation over "
        "them; a dash: not defined.",
        "",
        *([] if found.check is None else [found.check.markdown()]),
        "EMD, recall / precision, static false events in Hz, of each model:",
        "",
        *overview(found.rows),
        "",
        *table(found.rows),
        "",
        "| claim | | figures |",
        "|---|---|---|",
        *(f"| {c.claim} | {MET[c.met]} | {c.figures} |" for c in found.verdict),
        "",
        "Least EMD and best F1 (same pixel, 3 ms) of each case:",
        "",
        *(f"- {line}" for line in winners(found.cells)),
    ]
    lines += [f"- {line}" for line in found.left_out]
    return "\n".join(lines) + "\n"


MET = {True: "met", False: "missed", None: "-"}


def overview(rows: Sequence[Row]) -> list[str]:
    """Lines of Markdown: a line for each camera and kind of light, a column for each model."""
    judged = [row for row in rows if row.model not in (NOTHING, REFERENCE)]
    models = list(dict.fromkeys(row.model for row in judged))
    lines = ["| " + " | ".join(["camera", "light", *models]) + " |"]
    lines.append("|" + "---|" * (2 + len(models)))
    cases = dict.fromkeys((row.camera, light_words(row)) for row in judged)
    for camera, words in cases:
        here = {r.model: r.values for r in judged if (r.camera, light_words(r)) == (camera, words)}
        cells = [_in_short(here[model]) if model in here else "-" for model in models]
        lines.append("| " + " | ".join([camera, words, *cells]) + " |")
    return lines


def _in_short(values: dict[str, Value]) -> str:
    emd, recall, precision, static = (
        values[name].mean for name in ("emd", "recall", "precision", "static_hz")
    )
    shares = " / ".join(f"{v:.2f}" if math.isfinite(v) else "-" for v in (recall, precision))
    still = f"{static:.2g}" if math.isfinite(static) else "-"
    return f"{emd:.3f}, {shares}, {still}"


def table(rows: Sequence[Row]) -> list[str]:
    """Lines of Markdown."""
    headings = ["camera", "light", "model", *(column.heading for column in COLUMNS)]
    lines = ["| " + " | ".join(headings) + " |"]
    lines.append("|" + "|".join(["---"] * 3 + ["---:"] * len(COLUMNS)) + "|")
    for row in rows:
        cells = [row.camera, light_words(row), row.model]
        cells += [_number(row.values[column.value], column) for column in COLUMNS]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def light_words(row: Row | Cell) -> str:
    """How its light was traced."""
    if row.light == "path":
        return f"{row.spp} spp {row.seeds}"
    return row.light


def _number(value: Value, column: Column) -> str:
    if not math.isfinite(value.mean):
        return "-"
    told = f"{column.scale * value.mean:{column.form}}"
    if math.isfinite(value.spread):
        told += f" ± {column.scale * value.spread:{column.form}}"
    return told
