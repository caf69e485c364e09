"""The report of a training: NAME.training.json, and its curves as a picture."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import math
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evs.drivers.pictures import write_png
from evs.drivers.pictures.chart import RGB, Chart, Scale, Series, decades_around, draw_charts
from evs.drivers.run.report import write_whole
from evs.emulator.evsnet.export import export
from evs.msgs.pictures import U8
from evs_lab.training.settings import Variant
from evs_lab.training.shards import read_meta
from evs_lab.training.training_examples import TrainingExamples
from evs_lab.training.training_loop import TrainedNetwork

PACKAGES = ("evs", "jax", "jaxlib", "numpy", "optax")
CHART_PX = (680, 400)

FRESH_RGB: tuple[RGB, ...] = ((250, 200, 130), (240, 150, 60), (205, 95, 20), (130, 50, 5))
FIXED_RGB: tuple[RGB, ...] = ((160, 205, 240), (95, 160, 215), (35, 105, 175), (10, 55, 110))
"""from the fewest samples a pixel to the most"""
PLAIN_RGB: RGB = (60, 60, 60)
ON_OFF_RGB: tuple[RGB, RGB] = ((0, 114, 255), (224, 48, 16))


def write_network(fitted: TrainedNetwork, folder: Path) -> list[Path]:
    """Write NAME.onnx, NAME.toml, NAME.training.json and NAME.training.png; return their paths.

    Raises:
        EvsError: the disk is full, or a file cannot be written.
    """
    stem = folder / fitted.weights.name
    report = report_of(fitted)
    files = list(export(fitted.weights, stem.with_suffix(".onnx"), sidecar_of(fitted)))
    numbers, curves = (stem.with_name(f"{stem.name}.training.{end}") for end in ("json", "png"))
    write_whole(json.dumps(report, indent=2, allow_nan=False) + "\n", numbers)
    write_png(curves, curves_page(fitted), few_colours=True)
    return [*files, numbers, curves]


def sidecar_of(fitted: TrainedNetwork) -> dict[str, Any]:
    """The table [training] of the sidecar."""
    at = fitted.checkpoint
    return {
        "recipe": fitted.recipe.name,
        "seed": fitted.seed,
        "data_seed": fitted.examples.settings.seed,
        "scenes": len(fitted.examples.training),
        "step": at.best_step,
        "score": at.best_score,
        "report": f"{fitted.weights.name}.training.json",
    }


def report_of(fitted: TrainedNetwork) -> dict[str, Any]:
    """The report, in values of JSON."""
    at, examples = fitted.checkpoint, fitted.examples
    settings = examples.settings.plain()
    del settings["variants"]
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {
        "network": fitted.weights.name,
        "recipe": json.loads(json.dumps(dataclasses.asdict(fitted.recipe))),
        "seed": fitted.seed,
        "data": {
            **settings,
            "training_scenes": [int(path.stem) for path in examples.training],
            "held_out_scenes": [int(path.stem) for path in examples.held_out],
            **_randomised(examples),
        },
        "steps": at.step,
        "minutes": round(at.elapsed_s / 60.0, 2),
        "best_step": at.best_step,
        "score": at.best_score,
        "tau_s": fitted.weights.tau_s,
        "held_out": [
            {
                **dataclasses.asdict(variant),
                "network": mine.plain(),
                "plain": plain.plain(),
                "silence_emd": fitted.silence.emd,
            }
            for variant, mine, plain in zip(
                fitted.recipe.variants, fitted.scores, fitted.plain, strict=True
            )
        ],
        "curves": at.curves,
        "versions": versions,
    }


def _randomised(examples: TrainingExamples) -> dict[str, Any]:
    """The sensors that were drawn for the scenes, where the data have ranges of them."""
    if not examples.settings.randomise:
        return {}
    paths = [*examples.training, *examples.held_out]
    return {"randomised": {int(path.stem): read_meta(path).get("randomised") for path in paths}}


def curves_page(fitted: TrainedNetwork) -> U8:
    """(height, width, 3): loss, EMD, counts and false events over steps."""
    charts = [_loss(fitted), _emd(fitted), _counts(fitted), _spurious(fitted)]
    return draw_charts(charts, 2, CHART_PX)


def _steps(fitted: TrainedNetwork) -> tuple[list[float], Scale]:
    steps = [float(step) for step in fitted.checkpoint.curves["step"]]
    return steps, Scale(0.0, max(1.0, *steps))


def _curve(fitted: TrainedNetwork, key: str, variant: int) -> list[float]:
    """A score of one variant over validations; NaN where it has none."""
    values = [scores[variant][key] for scores in fitted.checkpoint.curves["scores"]]
    return [math.nan if value is None else value for value in values]


def _loss(fitted: TrainedNetwork) -> Chart:
    steps, x = _steps(fitted)
    curves = fitted.checkpoint.curves
    # prices of events can make it negative, where a logarithm is not defined
    loss = [math.nan if value is None or value <= 0 else value for value in curves["loss"]]
    series = [
        _line(steps, loss, ON_OFF_RGB[0], "training loss"),
        _line(steps, curves["score"], ON_OFF_RGB[1], "score, held out"),
    ]
    y = Scale(*decades_around([*loss, *curves["score"]]), log=True)
    title = f"{fitted.weights.name}: best at step {fitted.checkpoint.best_step}"
    return Chart(title, x, y, "steps", _with_labels(series))


def _emd(fitted: TrainedNetwork) -> Chart:
    _, x = _steps(fitted)
    series, every = _of_variants(fitted, "emd")
    y = Scale(*decades_around([*every, fitted.silence.emd]), log=True)
    return Chart("EMD of held-out pixels, events", x, y, "steps", _with_labels(series),
                 marks=[(fitted.silence.emd, "no events at all")])  # fmt: skip


def _counts(fitted: TrainedNetwork) -> Chart:
    steps, x = _steps(fitted)
    series = []
    for key, colour in (("on", ON_OFF_RGB[0]), ("off", ON_OFF_RGB[1])):
        for place in range(len(fitted.recipe.variants)):
            label = f"{key.upper()}, each variant" if not place else ""
            series.append(_line(steps, _curve(fitted, key, place), colour, label))
    return Chart("Events per true event", x, Scale(0.0, 2.0), "steps", _with_labels(series),
                 marks=[(1.0, "right")])  # fmt: skip


def _spurious(fitted: TrainedNetwork) -> Chart:
    _, x = _steps(fitted)
    series, every = _of_variants(fitted, "spurious_hz")
    low, high = decades_around([value for value in every if value >= 1e-3])
    return Chart("Events of still pixels, Hz", x, Scale(low, high, log=True), "steps",
                 _with_labels(series))  # fmt: skip


def _of_variants(fitted: TrainedNetwork, key: str) -> tuple[list[Series], list[float]]:
    """A curve of each variant of the light, and all their values."""
    steps, _ = _steps(fitted)
    series, every = [], []
    for place, variant in enumerate(fitted.recipe.variants):
        values = _curve(fitted, key, place)
        every += values
        series.append(_line(steps, values, _colour(fitted, variant), _words(variant)))
    return series, every


def _line(x: list[float], y: list[float], colour: RGB, label: str) -> Series:
    return Series(x, y, colour, label, line=True)


def _with_labels(series: list[Series]) -> list[Series]:
    """Draw a single validation as a point, not as a line."""
    if all(len(one.x) > 1 for one in series):
        return series
    return [dataclasses.replace(one, line=False) for one in series]


def _words(variant: Variant) -> str:
    return f"{variant.spp} {variant.seeds}"


def _colour(fitted: TrainedNetwork, variant: Variant) -> RGB:
    """Colour by samples a pixel: the more, the darker."""
    counts = sorted({one.spp for one in fitted.recipe.variants if one.seeds == variant.seeds})
    shades: Sequence[RGB] = FRESH_RGB if variant.seeds == "fresh" else FIXED_RGB
    place = counts.index(variant.spp)
    return shades[round(place * (len(shades) - 1) / max(1, len(counts) - 1))]
