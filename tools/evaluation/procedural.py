"""Procedural scenes for evaluation: the recipe of training, of a seed that training never has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evs.emulator.config import CameraConfig
from evs.msgs import EvsError
from evs.tools.evaluation.clip import TICK_US
from evs.tools.evaluation.scene_setup import SceneSetup
from evs.tools.training.pilot import run_pilot
from evs.tools.training.scenes import CAMERA, START, make_scene
from evs.tools.training.traced_scene import load_scene, simulate_scene

FIRST_SEED = 2**63
"""Training takes seeds below it; those from it on are for evaluation."""
MOST = 1000
ATTEMPTS = 20
_LOOK_TICKS = 128
_LOOK_SEED = 0


def procedural_setup(name: str, number: str) -> SceneSetup:
    """Scene procedural/NUMBER.

    Its camera stands where the recipe's first is; the evaluation moves it. So that a scene is of
    use, something else has to move too.

    Raises:
        EvsError: no number, or none of its attempts is of use.
    """
    if not (number.isdecimal() and int(number) < MOST):
        raise EvsError(f"scene '{name}': give procedural/0 ... procedural/{MOST - 1}")
    for attempt in range(ATTEMPTS):
        scene = make_scene(FIRST_SEED, int(number), attempt)
        try:
            moving = simulate_scene(scene, _LOOK_TICKS, TICK_US, 1)
        except EvsError:
            # it flies apart; the next one may not
            continue
        first = moving.snapshots[0].cameras
        held = tuple(replace(snapshot, cameras=first) for snapshot in moving.snapshots)
        pilot = run_pilot(replace(moving, snapshots=held), _LOOK_SEED)
        if not pilot.is_useful or pilot.is_still:
            continue
        model = load_scene(scene)
        return SceneSetup(
            name,
            model,
            CameraConfig(),
            camera=CAMERA,
            soft=bool(np.any(model.light_bulbradius > 0.0)),
            keyframe=START,
            warm_ticks=0,
            stands=True,
            bounces=scene.bounces,
            flicker=scene.flicker,
        )
    raise EvsError(f"scene '{name}': none of {ATTEMPTS} attempts is of any use; take another")
