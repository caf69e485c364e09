"""The result of an evaluation of video as a Markdown table and as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

from evs_lab.evaluation.reconstruct import TRUTH, VideoCell, VideoEvaluation
from evs_lab.evaluation.table import finite

MEASURES = {"ssim": "SSIM", "correlation": "corr.", "lpa": "LPA"}
"""fields of PictureMeasures -> headings"""
FORMS = {"ssim": ".3f", "correlation": ".3f", "lpa": ".2f"}


def summary(cell: VideoCell) -> dict[str, dict[str, tuple[float, float]]]:
    """Reconstructor -> measure -> its mean and its standard deviation over the times."""
    return {
        name: {
            measure: (float(np.mean(values)), float(np.std(values)))
            for measure, values in asdict(found).items()
        }
        for name, found in cell.measures.items()
    }


def video_markdown(found: VideoEvaluation) -> str:
    """The command and the table."""
    headings = ["scene", "camera", "light", "model", "events Hz"]
    headings += [f"{name}: {word}" for name in found.reconstructors for word in MEASURES.values()]
    lines = [
        f"    {found.command}",
        "",
        "Mean over the times ± standard deviation.",
        "",
        "| " + " | ".join(headings) + " |",
        "|" + "|".join(["---"] * 4 + ["---:"] * (len(headings) - 4)) + "|",
    ]
    for cell in found.cells:
        hz = "-" if cell.model == TRUTH else f"{cell.events_hz:.3g}"
        words = [cell.scene, cell.camera, cell.light, cell.model, hz]
        for values in summary(cell).values():
            words += [f"{mean:{FORMS[m]}} ± {std:{FORMS[m]}}" for m, (mean, std) in values.items()]
        lines.append("| " + " | ".join(words) + " |")
    return "\n".join([*lines, *(f"- {line}" for line in found.left_out)]) + "\n"


def video_json(found: VideoEvaluation) -> str:
    """Indented text; every time of every clip, but no pictures."""
    cells: list[dict[str, Any]] = []
    for cell in found.cells:
        plain = {name: value for name, value in vars(cell).items() if name != "pictures"}
        cells.append({**plain, "measures": {k: asdict(v) for k, v in cell.measures.items()}})
    told = {name: value for name, value in vars(found).items() if name != "cells"}
    return json.dumps(finite({**told, "cells": cells}), indent=1) + "\n"
