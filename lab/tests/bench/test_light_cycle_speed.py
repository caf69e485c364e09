"""Time of a tick of `path`: fixed seeds, a cycle of seeds with as many samples a tick, and four
times as many at the edges of geoms."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import CameraPose, SceneSnapshot
from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from evs_lab.evaluation.clip import PAN_PX_S, camera_motion
from speed.turns import Table, Time, spread
from speed.view import HEIGHT, PRIMITIVES, WIDTH, View, film, robot

BLOCK, ROUNDS = 8, 8
"""Ticks that are timed together: whole cycles, so that each set has as many in every round."""
LIGHTS = {
    "fixed 4": RenderConfig(renderer="path", spp=4),
    "cycle of 4 x 4": RenderConfig(renderer="path", spp=4, seeds="cycle"),
    "16 at edges": RenderConfig(renderer="path", spp=16, antialiasing="adaptive"),
    "cycle, 16 at edges": RenderConfig(
        renderer="path", spp=16, antialiasing="adaptive", seeds="cycle"
    ),
    "fixed 16": RenderConfig(renderer="path", spp=16),
}
Film = list[tuple[SceneSnapshot, CameraPose]]


def timed(renderer: Renderer, shots: Film) -> tuple[float, float]:
    """Mean ms of a tick, and mean share of the pixels that was traced."""
    traced, begin = 0.0, time.perf_counter()
    for shot in shots:
        renderer.render(*shot)
        traced += renderer.traced_fraction
    return 1e3 * (time.perf_counter() - begin) / len(shots), traced / len(shots)


def times_of(view: View, motion: str) -> tuple[dict[str, Time], dict[str, float]]:
    """Time of a tick by kind of light, blocks of ticks in turns; and the share that was traced."""
    moved = camera_motion(motion, view.camera)
    shots = [(shot, moved(shot.cameras[0], shot.t_us)) for shot in film(view, BLOCK * (ROUNDS + 1))]
    renderers = {
        name: make_renderer(view.content, view.camera, render, 1) for name, render in LIGHTS.items()
    }
    means: dict[str, list[float]] = {name: [] for name in LIGHTS}
    shares: dict[str, list[float]] = {name: [] for name in LIGHTS}
    for block in range(ROUNDS + 1):
        part = shots[block * BLOCK : (block + 1) * BLOCK] if block else shots[: 2 * BLOCK]
        for name, renderer in renderers.items():
            mean, share = timed(renderer, part)
            # the first round traces what a cache begins with
            if block:
                means[name].append(mean)
                shares[name].append(share)
    return (
        {name: spread(found) for name, found in means.items()},
        {name: float(np.mean(found)) for name, found in shares.items()},
    )


@pytest.mark.bench
@pytest.mark.parametrize("motion", ["pan", "still"])
def test_a_tick_of_a_cycle(robot_files: dict[str, Path], motion: str) -> None:
    found = {name: times_of(robot(robot_files[name]), motion) for name in PRIMITIVES}
    speed = f" ({PAN_PX_S:g} px/s)" if motion == "pan" else ""
    title = f"path, {WIDTH}x{HEIGHT}, 1 thread, camera: {motion}{speed}"
    yardsticks = dict.fromkeys(list(LIGHTS)[1:], "fixed 4")
    print(Table(title, {scene: times for scene, (times, _) in found.items()}, yardsticks))
    for scene, (_, shares) in found.items():
        traced = ", ".join(f"{name} {share:.3f}" for name, share in shares.items())
        print(f"share of the pixels that is traced, {scene}: {traced}")
        assert all(0 <= share <= 1 for share in shares.values())
