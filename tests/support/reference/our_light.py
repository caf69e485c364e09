"""Our own renderers as estimators: independent batches whose mean is the light of the pixel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.render import make_renderer
from reference.stage import Stage

F64 = npt.NDArray[np.float64]


def direct_batches(stage: Stage, batches: int, across: int = 8, seed: int = 0) -> F64:
    """(batches, h, w): `direct` at across x across points a pixel, a lattice shifted at random.

    Each pixel is traced as a picture of its own, one ray a cell. The shift is uniform over a cell
    and the same in all, so each batch is an unbiased estimate of the pixel's mean.
    """
    rng = np.random.default_rng(seed)
    camera, width, height = stage.camera, stage.camera.width, stage.camera.height
    config = replace(stage.render, renderer="direct", spp=1, seeds="fixed", incremental=False)
    found = np.empty((batches, height, width))
    for k in range(batches):
        x, y = rng.uniform(-0.5, 0.5, 2)
        fine = replace(
            camera,
            width=width * across,
            height=height * across,
            fx=camera.fx * across,
            fy=camera.fy * across,
            cx=camera.cx * across + x,
            cy=camera.cy * across + y,
        )
        renderer = make_renderer(stage.scene, fine, config, 2)
        light = np.asarray(renderer.render(stage.shot, stage.pose), np.float64)
        found[k] = light.reshape(height, across, width, across).mean((1, 3))
    return found


def path_batches(stage: Stage, batches: int, spp: int) -> F64:
    """(batches, h, w): `path` with new seeds each tick."""
    config = replace(stage.render, renderer="path", spp=spp, seeds="fresh", bounces=stage.bounces)
    renderer = make_renderer(stage.scene, stage.camera, config, 2)
    return np.stack(
        [
            np.array(renderer.render(replace(stage.shot, t_us=1000 * k), stage.pose), np.float64)
            for k in range(batches)
        ]
    )


def path_caster(stage: Stage) -> tuple[Any, tuple[F64, ...]]:
    """The native caster behind `path`, and where everything is, as it wants to be told."""
    renderer: Any = make_renderer(
        stage.scene, stage.camera, replace(stage.render, renderer="path"), 1
    )
    return renderer._caster, renderer._place(stage.shot, stage.pose)
