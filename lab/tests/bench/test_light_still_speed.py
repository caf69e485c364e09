"""Time of a tick with a camera that stands still: only what something moved can touch is traced."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import SceneSnapshot
from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from speed.turns import Table, Time, spread, target
from speed.view import HEIGHT, PRIMITIVES, WIDTH, View, film, robot

TICKS, PASSES = 200, 3
FULL_TICKS = 10
"""Of them, as many are enough for full frames."""
FULL = "full frame, {} spp, 1 thread"
STILL = [(1, 1), (1, 2), (4, 1)]
"""Samples a pixel, threads."""


def renderers(view: View) -> dict[str, Renderer]:
    """By row."""

    def make(spp: int, threads: int, incremental: bool) -> Renderer:
        config = RenderConfig(spp=spp, antialiasing="fixed", incremental=incremental)
        return make_renderer(view.content, view.camera, config, threads)

    found = {FULL.format(spp): make(spp, 1, False) for spp in (1, 4)}
    return found | {still(spp, threads): make(spp, threads, True) for spp, threads in STILL}


def still(spp: int, threads: int) -> str:
    """The row's name."""
    return f"still camera, {spp} spp, {threads} thread{'s' if threads > 1 else ''}"


def mean_ms(renderer: Renderer, shots: list[SceneSnapshot]) -> tuple[float, float]:
    """Of a tick after the first, and the share of the pixels that was traced."""
    renderer.render(shots[0], shots[0].cameras[0])
    traced, busy = 0.0, 0.0
    for shot in shots[1:]:
        begin = time.perf_counter()
        renderer.render(shot, shot.cameras[0])
        busy += time.perf_counter() - begin
        traced += renderer.traced_fraction
    return 1e3 * busy / (len(shots) - 1), traced / (len(shots) - 1)


def times_of(view: View) -> tuple[dict[str, Time], float]:
    """The means of PASSES passes, which take turns; and the share that was traced."""
    shots, rows = film(view, TICKS), renderers(view)
    means: dict[str, list[float]] = {row: [] for row in rows}
    shares = []
    for _ in range(PASSES):
        for row, renderer in rows.items():
            whole = row.startswith("full")
            mean, share = mean_ms(renderer, shots[: FULL_TICKS + 1] if whole else shots)
            means[row].append(mean)
            shares += [] if whole else [share]
    # what was kept is right
    last = shots[-1], shots[-1].cameras[0]
    for spp in (1, 4):
        light = rows[FULL.format(spp)].render(*last)
        np.testing.assert_array_equal(rows[still(spp, 1)].render(*last), light)
    return {row: spread(samples) for row, samples in means.items()}, statistics.mean(shares)


@pytest.mark.bench
def test_still_camera(robot_files: dict[str, Path]) -> None:
    columns, shares = {}, {}
    for scene in PRIMITIVES:
        columns[scene], shares[scene] = times_of(robot(robot_files[scene]))
    title = f"direct with a still camera, {WIDTH}x{HEIGHT}: mean of {TICKS} ticks of 1 ms"
    yardsticks = {still(spp, threads): FULL.format(spp) for spp, threads in STILL}
    print(Table(title, columns, yardsticks))
    print(
        "traced_fraction: " + ", ".join(f"{scene} {share:.3g}" for scene, share in shares.items())
    )
    for scene in PRIMITIVES:
        for spp in (1, 4):
            row = still(spp, 1)
            print(target(f"{row}, {scene}", columns[scene][row].median, 0.3, "ms"))
