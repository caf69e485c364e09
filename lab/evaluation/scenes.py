"""The scenes that models are judged on, by name. No network was trained on any of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from evs.emulator.base.package_paths import in_package
from evs.emulator.config import CameraConfig, FlickerConfig
from evs.emulator.world import MjModel, load_model
from evs.msgs import EvsError
from evs_lab.training.pilot import run_pilot
from evs_lab.training.scenes import CAMERA, START, make_scene
from evs_lab.training.traced_scene import load_scene, simulate_scene


@dataclass(frozen=True)
class SceneSetup:
    """A world, its view and how long it has moved before the first image."""

    DIGEST_NAME: ClassVar[str] = "Stage"

    name: str
    model: MjModel
    view: CameraConfig
    """viewpoint of the free camera"""
    camera: str = ""
    """a camera of the model instead"""
    soft: bool = False
    """whether a light has a size, so that shadows are soft"""
    keyframe: str = ""
    """initial state"""
    warm_ticks: int = 100
    """ms of simulation before the first image"""
    stands: bool = False
    """whether the camera keeps its first pose"""
    bounces: int = 2
    flicker: tuple[FlickerConfig, ...] = ()
    sky: str = "backdrop"
    """as of [render]; robots and procedural scenes are lit by theirs"""


BULB = 0.1
"""Radius of a robot's lamps, as a share of their distance from the model's centre: soft light."""

FOLDERS = {
    "gymnasium": "envs/mujoco/assets",
    "dm_control": "suite",
    "gymnasium_robotics": "envs/assets",
}
"""Python package -> where its robots lie."""

VIEWS = {
    "gymnasium/ant": (0, 0, 0.5, 4.0),
    "gymnasium/half_cheetah": (0, 0, 0.5, 3.0),
    "gymnasium/hopper": (0, 0, 0.8, 3.0),
    "gymnasium/humanoid": (0, 0, 0.9, 3.0),
    "gymnasium/walker2d": (0, 0, 0.8, 3.0),
    "dm_control/cartpole": (0, 0, 1.3, 3.0),
    "dm_control/cheetah": (0, 0, 0.5, 3.0),
    "dm_control/dog": (0, 0, 0.5, 2.5),
    "dm_control/finger": (0, 0, 0.3, 1.0),
    "dm_control/humanoid": (0, 0, 0.9, 3.0),
    "dm_control/quadruped": (0, 0, 0.4, 3.0),
    "dm_control/walker": (0, 0, 0.9, 3.0),
    "gymnasium_robotics/fetch/pick_and_place": (1.0, 0.75, 0.6, 2.2),
    "gymnasium_robotics/hand/manipulate_block": (1.0, 0.9, 0.2, 0.7),
}
"""robot -> (x, y, z of the point that is looked at, distance from it), m."""

DEFAULT = (
    *("gymnasium/ant", "gymnasium/half_cheetah", "gymnasium/humanoid"),
    *("dm_control/cartpole", "dm_control/humanoid"),
    *("procedural/0", "procedural/1", "procedural/2", "procedural/3", "procedural/4"),
)
"""Looked at when pipelines and their constants were chosen, though no network learnt from them."""
HELD_OUT = (
    *("dm_control/dog", "dm_control/quadruped"),
    *("gymnasium_robotics/fetch/pick_and_place", "gymnasium_robotics/hand/manipulate_block"),
)
"""Never to be looked at when anything is trained, tuned or chosen: for a verdict alone."""
SETS = {"default": DEFAULT, "held_out": HELD_OUT}
"""names that stand for several scenes"""
QUICK = ("gymnasium/humanoid", "procedural/0")

FIRST_SEED = 2**63
"""Training takes seeds below it; those from it on are for evaluation."""
MOST = 1000
"""how many procedural scenes there are"""
ATTEMPTS = 20
"""how many draws a procedural scene may take"""
# of the trial run that rates a draw
_LOOK_TICKS, _LOOK_TICK_US = 128, 1000
_LOOK_SEED = 0


def scene_setup(name: str) -> SceneSetup:
    """The scene: PACKAGE/ROBOT, procedural/NUMBER, FILE or package:path.

    The lamps of a robot get a size, so that its shadows are soft, and its sky lights it.

    Raises:
        EvsError: no such scene, or the package that holds it is not installed.
    """
    package, _, robot = name.partition("/")
    if package == "procedural":
        return procedural_setup(name, robot)
    if package in FOLDERS and not name.endswith(".xml"):
        return _robot(name, package, robot)
    model = load_model(in_package(name))
    return SceneSetup(name, model, CameraConfig(), soft=_has_bulb(model))


def _robot(name: str, package: str, robot: str) -> SceneSetup:
    try:
        model = load_model(in_package(f"{package}:{FOLDERS[package]}/{robot}.xml"))
    except EvsError as error:
        known = [known for known in VIEWS if known.startswith(f"{package}/")]
        raise EvsError(f"scene '{name}': {error}; of {package} known to serve: "
                       f"{', '.join(known)}") from None  # fmt: skip
    away = np.linalg.norm(model.light_pos - model.stat.center, axis=1)
    model.light_bulbradius[:] = BULB * away
    if name not in VIEWS:
        return SceneSetup(name, model, CameraConfig(), soft=bool(model.nlight), sky="light")
    x, y, z, distance = VIEWS[name]
    view = CameraConfig(lookat=(x, y, z), distance=distance, azimuth=90, elevation=-20)
    return SceneSetup(name, model, view, soft=bool(model.nlight), sky="light")


def _has_bulb(model: MjModel) -> bool:
    return bool(np.any(model.light_bulbradius > 0.0))


def check_names(names: Sequence[str]) -> tuple[str, ...]:
    """The scenes of a list; sets become single scenes. EvsError: there is none, or one twice."""
    if not names:
        raise EvsError(f"no scene is given; give for example {', '.join(QUICK)}")
    names = [one for name in names for one in SETS.get(name, (name,))]
    for name in names:
        if names.count(name) > 1:
            raise EvsError(f"scene '{name}' is given twice in the list; leave one out")
    return tuple(names)


def procedural_setup(name: str, number: str) -> SceneSetup:
    """Scene procedural/NUMBER.

    The recipe of training, with a seed that training never uses. The camera stands where the
    recipe's first one is, and the evaluation moves it; a useful scene has something else that
    moves.

    Args:
        name: of the scene, for messages.
        number: text of a whole number below MOST.

    Raises:
        EvsError: no number, or none of its attempts is of use.
    """
    if not (number.isdecimal() and int(number) < MOST):
        raise EvsError(f"scene '{name}': give procedural/0 ... procedural/{MOST - 1}")
    for attempt in range(ATTEMPTS):
        scene = make_scene(FIRST_SEED, int(number), attempt)
        try:
            moving = simulate_scene(scene, _LOOK_TICKS, _LOOK_TICK_US, 1)
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
            sky="light",
        )
    raise EvsError(f"scene '{name}': none of {ATTEMPTS} attempts is of any use; take another")
