"""The result of an evaluation as a Markdown table and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from evs_lab.evaluation.aggregate import Aggregate, ResultCell, ResultRow, aggregate_rows
from evs_lab.evaluation.claims import NOTHING, REFERENCE, Claim, check_claims, winners
from evs_lab.evaluation.network_check import NetworkReport


@dataclass(frozen=True)
class MetricColumn:
    """One value of a row in the Markdown table."""

    heading: str
    value: str
    """its name in aggregate.VALUES"""
    form: str
    """of the number"""
    scale: float = 1.0


COLUMNS = (
    MetricColumn("EMD", "emd", ".3f"),
    MetricColumn("ON", "count_on", ".2f"),
    MetricColumn("OFF", "count_off", ".2f"),
    MetricColumn("static Hz", "static_hz", ".3g"),
    MetricColumn("spurious Hz", "spurious_hz", ".3g"),
    MetricColumn("recall", "recall", ".2f"),
    MetricColumn("precision", "precision", ".2f"),
    MetricColumn("patch recall", "patch_recall", ".2f"),
    MetricColumn("patch precision", "patch_precision", ".2f"),
    MetricColumn("delay ms", "delay_us", ".2f", 1e-3),
    MetricColumn("timing ms", "timing_us", ".2f", 1e-3),
    MetricColumn("RMSE Hz", "rmse_hz", ".3g"),
    MetricColumn("KL", "kl_nats", ".3f"),
    MetricColumn("corr.", "correlation", ".3f"),
    MetricColumn("ms per tick", "ms_per_tick", ".2f"),
)


@dataclass(frozen=True)
class ClipFacts:
    """Facts about one clip."""

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
    clips: list[ClipFacts] = field(default_factory=list)
    cells: list[ResultCell] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    """a line for each model that is not there"""
    check: NetworkReport | None = None
    """of a user's own network"""

    @property
    def rows(self) -> list[ResultRow]:
        """The table: all scenes of one camera motion together."""
        return aggregate_rows(self.cells)

    @property
    def claims(self) -> list[Claim]:
        """Whether each claim is met."""
        return check_claims(self.cells)

    def plain(self) -> dict[str, Any]:
        """Nested dicts and lists, strict JSON: None where a value is not defined."""
        plain: dict[str, Any] = finite(
            {
                "command": self.command,
                "settings": self.settings,
                "versions": self.versions,
                "left_out": self.left_out,
                "check": None if self.check is None else asdict(self.check),
                "takes": [asdict(clip) for clip in self.clips],
                "rows": [_row(row) for row in self.rows],
                "verdict": [asdict(claim) for claim in self.claims],
                "winners": winners(self.cells),
                "cells": [asdict(cell) for cell in self.cells],
            }
        )
        return plain

    def to_json(self) -> str:
        """Indented text."""
        return json.dumps(self.plain(), indent=1, allow_nan=False) + "\n"


def _row(row: ResultRow) -> dict[str, Any]:
    plain = asdict(row)
    for name, value in plain.pop("values").items():
        plain[name], plain[f"{name}_spread"] = value["mean"], value["spread"]
    return plain


def finite(value: Any) -> Any:
    """The same without NaN and infinity: None."""
    if isinstance(value, dict):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def markdown(found: Evaluation) -> str:
    """The command, the table and the verdict."""
    scenes = list(dict.fromkeys(clip.scene for clip in found.clips))
    lines = [
        f"    {found.command}",
        "",
        f"{len(scenes)} scenes: {', '.join(scenes)}. Values are means over the scenes "
        "± standard deviation; a dash means not defined.",
        "",
        *([] if found.check is None else [found.check.markdown()]),
        "Each cell gives EMD, recall / precision, and static false events in Hz:",
        "",
        *overview(found.rows),
        "",
        *table(found.rows),
        "",
        "| claim | | figures |",
        "|---|---|---|",
        *(f"| {c.claim} | {MET[c.met]} | {c.figures} |" for c in found.claims),
        "",
        "Each claim for each scene:",
        "",
        *claims_by_scene(found.cells),
        "",
        f"EMD on each scene; {WORSE} means that no events at all would be closer:",
        "",
        *emd_by_scene(found.cells),
        "",
        "Lowest EMD and best F1 (same pixel, 3 ms) in each case:",
        "",
        *(f"- {line}" for line in winners(found.cells)),
    ]
    lines += [f"- {line}" for line in found.left_out]
    return "\n".join(lines) + "\n"


MET = {True: "met", False: "missed", None: "-"}
WORSE = "†"
"""beside an EMD that silence beats"""


def claims_by_scene(cells: Sequence[ResultCell]) -> list[str]:
    """Lines of Markdown: a line for each claim, a column for each scene."""
    scenes = list(dict.fromkeys(cell.scene for cell in cells))
    judged = [check_claims([c for c in cells if c.scene == scene]) for scene in scenes]
    lines = ["| " + " | ".join(["claim", *scenes]) + " |", "|---" * (1 + len(scenes)) + "|"]
    for of_scenes in zip(*judged, strict=True):
        lines.append(
            "| " + " | ".join([of_scenes[0].claim, *(MET[claim.met] for claim in of_scenes)]) + " |"
        )
    return lines


def emd_by_scene(cells: Sequence[ResultCell]) -> list[str]:
    """Lines of Markdown: a line for each camera, light and model, a column for each scene."""
    scenes = list(dict.fromkeys(cell.scene for cell in cells))
    found = {(c.camera, light_label(c), c.model, c.scene): c.measures.emd for c in cells}
    silence = {(c.camera, c.scene): c.measures.emd for c in cells if c.model == NOTHING}
    lines = ["| " + " | ".join(["camera", "light", "model", *scenes]) + " |"]
    lines.append("|" + "|".join(["---"] * 3 + ["---:"] * len(scenes)) + "|")
    for row in dict.fromkeys((c.camera, light_label(c), c.model) for c in cells):
        line = list(row)
        for scene in scenes:
            emd = found.get((*row, scene), math.nan)
            worse = f" {WORSE}" if emd > silence.get((row[0], scene), math.inf) else ""
            line.append(f"{emd:.3f}{worse}" if math.isfinite(emd) else "-")
        lines.append("| " + " | ".join(line) + " |")
    return lines


def overview(rows: Sequence[ResultRow]) -> list[str]:
    """Lines of Markdown: a line for each camera and kind of light, a column for each model."""
    judged = [row for row in rows if row.model not in (NOTHING, REFERENCE)]
    models = list(dict.fromkeys(row.model for row in judged))
    lines = ["| " + " | ".join(["camera", "light", *models]) + " |"]
    lines.append("|" + "---|" * (2 + len(models)))
    cases = dict.fromkeys((row.camera, light_label(row)) for row in judged)
    for camera, words in cases:
        subset = {
            r.model: r.values for r in judged if (r.camera, light_label(r)) == (camera, words)
        }
        cells = [_in_short(subset[model]) if model in subset else "-" for model in models]
        lines.append("| " + " | ".join([camera, words, *cells]) + " |")
    return lines


def _in_short(values: dict[str, Aggregate]) -> str:
    emd, recall, precision, static = (
        values[name].mean for name in ("emd", "recall", "precision", "static_hz")
    )
    shares = " / ".join(f"{v:.2f}" if math.isfinite(v) else "-" for v in (recall, precision))
    still = f"{static:.2g}" if math.isfinite(static) else "-"
    return f"{emd:.3f}, {shares}, {still}"


def table(rows: Sequence[ResultRow]) -> list[str]:
    """Lines of Markdown."""
    headings = ["camera", "light", "model", *(column.heading for column in COLUMNS)]
    lines = ["| " + " | ".join(headings) + " |"]
    lines.append("|" + "|".join(["---"] * 3 + ["---:"] * len(COLUMNS)) + "|")
    for row in rows:
        cells = [row.camera, light_label(row), row.model]
        cells += [_number(row.values[column.value], column) for column in COLUMNS]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def light_label(row: ResultRow | ResultCell) -> str:
    """How its light was traced."""
    if row.light == "path":
        return f"{row.spp} spp {row.seeds}"
    if row.model in (NOTHING, REFERENCE):
        return row.light
    edges = " at edges" if row.antialiasing == "adaptive" else ""
    return f"{row.light}, {row.spp} spp{edges}"


def _number(value: Aggregate, column: MetricColumn) -> str:
    if not math.isfinite(value.mean):
        return "-"
    text = f"{column.scale * value.mean:{column.form}}"
    if math.isfinite(value.spread):
        text += f" ± {column.scale * value.spread:{column.form}}"
    return text
