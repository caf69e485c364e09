"""The scenes that models are judged on, by name. None of them is ever trained on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evs.drivers.run.paths import in_package
from evs.emulator.config import CameraConfig
from evs.emulator.world import MjModel, load_model
from evs.msgs import EvsError
from evs.tools.evaluation.procedural import procedural_setup
from evs.tools.evaluation.scene_setup import SceneSetup

BULB = 0.1
"""Radius of a robot's lamps, as a share of their distance from the model's centre: soft light."""

FOLDERS = {"gymnasium": "envs/mujoco/assets", "dm_control": "suite"}
"""Python package -> where its robots lie."""

VIEWS = {
    "gymnasium/ant": (0.5, 4.0),
    "gymnasium/half_cheetah": (0.5, 3.0),
    "gymnasium/hopper": (0.8, 3.0),
    "gymnasium/humanoid": (0.9, 3.0),
    "gymnasium/walker2d": (0.8, 3.0),
    "dm_control/cartpole": (1.3, 3.0),
    "dm_control/cheetah": (0.5, 3.0),
    "dm_control/finger": (0.3, 1.0),
    "dm_control/humanoid": (0.9, 3.0),
    "dm_control/quadruped": (0.4, 3.0),
    "dm_control/walker": (0.9, 3.0),
}
"""robot -> (height of the point that is looked at, distance from it), m."""

DEFAULT = (
    *("gymnasium/ant", "gymnasium/half_cheetah", "gymnasium/humanoid"),
    *("dm_control/cartpole", "dm_control/humanoid", "dm_control/quadruped"),
    *("procedural/0", "procedural/1", "procedural/2", "procedural/3", "procedural/4"),
)
QUICK = ("gymnasium/humanoid", "procedural/0")


def scene_setup(name: str) -> SceneSetup:
    """The scene: gymnasium/ROBOT, dm_control/ROBOT, procedural/NUMBER, FILE, package:path.

    The lamps of a robot get a size, so that its shadows are soft.

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
        return SceneSetup(name, model, CameraConfig(), soft=bool(model.nlight))
    height, distance = VIEWS[name]
    view = CameraConfig(lookat=(0, 0, height), distance=distance, azimuth=90, elevation=-20)
    return SceneSetup(name, model, view, soft=bool(model.nlight))


def _has_bulb(model: MjModel) -> bool:
    return bool(np.any(model.light_bulbradius > 0.0))


def check_names(names: Sequence[str]) -> tuple[str, ...]:
    """The scenes of a list. EvsError where there is none, or one twice."""
    if not names:
        raise EvsError(f"no scene is given; give for example {', '.join(QUICK)}")
    for name in names:
        if names.count(name) > 1:
            raise EvsError(f"scene '{name}' is given twice in the list; leave one out")
    return tuple(names)
