"""The result of an evaluation of video as a Markdown table and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from evs.tools.evaluation.reconstruct import TRUTH, VideoCell, VideoEvaluation
from evs.tools.evaluation.table import finite

MEASURES = {"ssim": "SSIM", "correlation": "corr.", "lpa": "LPA"}
"""fields of PictureMeasures -> headings"""
FORMS = {"ssim": ".3f", "correlation": ".3f", "lpa": ".2f"}


@dataclass(frozen=True)
class VideoRow:
    """One model on one kind of light, all scenes of one camera motion together."""

    camera: str
    light: str
    model: str
    events_hz: float
    values: dict[str, dict[str, tuple[float, float]]]
    """reconstructor -> measure -> its mean over times and scenes, and its standard deviation over
    the times of a scene (root of the mean of the variances)"""


def video_rows(cells: Sequence[VideoCell]) -> list[VideoRow]:
    """The rows, in the order of their first cells."""
    groups: dict[tuple[str, str, str], list[VideoCell]] = {}
    for cell in cells:
        groups.setdefault((cell.camera, cell.light, cell.model), []).append(cell)
    return [
        VideoRow(
            *key,
            float(np.mean([cell.events_hz for cell in found])),
            {
                name: {
                    measure: _pooled([getattr(cell.measures[name], measure) for cell in found])
                    for measure in MEASURES
                }
                for name in found[0].measures
            },
        )
        for key, found in groups.items()
    ]


def _pooled(clips: list[list[float]]) -> tuple[float, float]:
    return float(np.mean(clips)), float(np.sqrt(np.mean(np.var(clips, axis=1))))


def video_markdown(found: VideoEvaluation) -> str:
    """The command and the table."""
    scenes = list(dict.fromkeys(cell.scene for cell in found.cells))
    headings = ["camera", "light", "model", "events Hz"]
    headings += [f"{name}: {word}" for name in found.reconstructors for word in MEASURES.values()]
    lines = [
        f"    {found.command}",
        "",
        f"{len(scenes)} scenes: {', '.join(scenes)}. Mean of all times and scenes ± standard "
        "deviation over the times.",
        "",
        "| " + " | ".join(headings) + " |",
        "|" + "|".join(["---"] * 3 + ["---:"] * (len(headings) - 3)) + "|",
    ]
    for row in video_rows(found.cells):
        hz = "-" if row.model == TRUTH else f"{row.events_hz:.3g}"
        words = [row.camera, row.light, row.model, hz]
        for name in found.reconstructors:
            for measure, form in FORMS.items():
                mean, spread = row.values[name][measure]
                words.append(f"{mean:{form}} ± {spread:{form}}")
        lines.append("| " + " | ".join(words) + " |")
    return "\n".join([*lines, *(f"- {line}" for line in found.left_out)]) + "\n"


def video_json(found: VideoEvaluation) -> str:
    """Indented text; every time of every clip, but no pictures."""
    cells: list[dict[str, Any]] = []
    for cell in found.cells:
        plain = {name: value for name, value in vars(cell).items() if name != "pictures"}
        cells.append({**plain, "measures": {k: asdict(v) for k, v in cell.measures.items()}})
    rows = [asdict(row) for row in video_rows(found.cells)]
    told = {name: value for name, value in vars(found).items() if name != "cells"}
    return json.dumps(finite({**told, "rows": rows, "cells": cells}), indent=1) + "\n"
