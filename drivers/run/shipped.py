"""The pipelines that come with evs: config/pipelines, each found by its bare name."""

from __future__ import annotations

import re
from pathlib import Path

PIPELINES = Path(__file__).parents[2] / "config" / "pipelines"

PRESETS = ("fast", "balanced", "accurate", "reference")
"""Those that trade speed for accuracy and need a scene beside them; the fastest first."""


def pipelines() -> dict[str, Path]:
    """name -> file: the presets in their order, then the others."""
    files = {file.stem: file for file in sorted(PIPELINES.glob("*.toml"))}
    first = {name: files.pop(name) for name in PRESETS if name in files}
    return first | files


def about(file: Path) -> str:
    """What a pipeline is for: the comment at its head, up to the first colon or full stop."""
    head = []
    for line in file.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        head.append(line.lstrip("# ").rstrip())
    return re.split(r"[.:;](?:\s|$)", " ".join(head))[0]
