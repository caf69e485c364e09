"""TracedScene: a training scene as it moves, and the light of its pixels, traced tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from evs.emulator.base.scene import F32, I32, CameraModel, SceneModel, SceneSnapshot
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import (
    MjModel,
    Physics,
    SnapshotTaker,
    bind_camera,
    extract_scene,
    find_keyframe,
    load_text,
)
from evs_lab.training.scenes import CAMERA, START, TrainingScene
from evs_lab.training.settings import HEIGHT, WIDTH, Variant

Moved = Callable[[int], None]
"""Called with the number of samples, over all pixels, since the last call."""


@dataclass(frozen=True)
class TracedScene:
    """All inputs of a renderer, for every tick."""

    scene: SceneModel
    camera: CameraModel
    """of WIDTH x HEIGHT px"""
    snapshots: tuple[SceneSnapshot, ...]
    """one a tick, the first at t = 0"""
    render: RenderConfig
    """settings that all variants share"""
    threads: int

    def renderer(self, variant: Variant, seed: int, shrink: int = 1) -> NativeRenderer:
        """The renderer of a variant.

        Args:
            variant: samples and seeds of the light.
            seed: of all random numbers.
            shrink: the image is smaller by this factor.
        """
        config = replace(self.render, renderer="path", spp=variant.spp, seeds=variant.seeds)
        camera = self.camera
        small = replace(
            camera,
            width=camera.width // shrink,
            height=camera.height // shrink,
            fx=camera.fx / shrink,
            fy=camera.fy / shrink,
            cx=camera.cx / shrink,
            cy=camera.cy / shrink,
        )
        return NativeRenderer(self.scene, small, config, self.threads, seed=seed)

    def light(self, pixels: I32, variant: Variant, seed: int, moved: Moved) -> F32:
        """Render the luminance of some pixels, (K, P) float32.

        Args:
            pixels: (P, 2) columns and rows.
            variant: samples and seeds of the light.
            seed: of the noise.
            moved: receives the samples that were traced.
        """
        renderer = self.renderer(variant, seed)
        found = np.zeros((len(self.snapshots), len(pixels)), np.float32)
        for tick, snapshot in enumerate(self.snapshots):
            found[tick] = renderer.trace(snapshot, snapshot.cameras[0], pixels)
            moved(variant.spp * len(pixels))
        return found


def load_scene(scene: TrainingScene) -> MjModel:
    """The MuJoCo model of a scene."""
    return load_text(scene.text, scene.files)


def simulate_scene(scene: TrainingScene, ticks: int, tick_us: int, threads: int) -> TracedScene:
    """Simulate a scene for all its ticks.

    Raises:
        EvsError: its physics breaks down.
    """
    model = load_scene(scene)
    physics = Physics(model, tick_us, find_keyframe(model, START))
    bound = bind_camera(model, CAMERA, WIDTH, HEIGHT)
    poser = SnapshotTaker(model, [bound])
    snapshots = [poser.snapshot(physics.data, 0, tick_us)]
    for _ in range(ticks - 1):
        physics.advance()
        snapshots.append(poser.snapshot(physics.data, physics.t_us, tick_us))
    render = RenderConfig(
        renderer="path", bounces=scene.bounces, flicker=scene.flicker, sky="light"
    )
    return TracedScene(extract_scene(model), bound.model, tuple(snapshots), render, threads)
