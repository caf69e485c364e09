"""Describe a data set, planned or existing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from evs.tools.dataset.manifest import MANIFEST, read_json
from evs.tools.dataset.scenes import SceneFile


def describe(folder: Path, scenes: Mapping[str, SceneFile]) -> Iterator[str]:
    """Lines for people: of the folder where there is a data set, else of what would be made."""
    if (folder / MANIFEST).exists():
        yield from _there(folder)
        return
    seconds = frames = 0.0
    for name, scene in scenes.items():
        seconds += scene.duration_s
        frames += scene.duration_s * scene.frames.fps
        light = f"{scene.render.renderer}, {scene.render.samples} samples an event tick"
        yield (
            f"{name:10s}{scene.duration_s:6.1f} s  {scene.place or 'own':8s}"
            f"{light}, {scene.frames.spp} a frame: {scene.about or scene.scene.file}"
        )
    yield (
        f"{'all':10s}{seconds:6.1f} s  {round(frames)} frames; what a second costs: "
        "docs/howto/datasets.md"
    )


def _there(folder: Path) -> Iterator[str]:
    manifest = read_json(folder / MANIFEST)
    for name, scene in manifest["scenes"].items():
        files = manifest["files"].items()
        own = {key: size["bytes"] for key, size in files if key.startswith(f"{name}/")}
        seconds = (scene["end_us"] - scene["begin_us"]) / 1e6
        yield (
            f"{name:10s}{seconds:6.1f} s  {scene['place'] or 'own':8s}{scene['frames']} frames, "
            f"{len(own)} files, {sum(own.values()) / 1e6:.1f} MB: {scene['about']}"
        )
    yield "versions  " + ", ".join(f"{key} {value}" for key, value in manifest["versions"].items())
