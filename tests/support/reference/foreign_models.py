"""Robots and scenes that nobody here wrote, as MJCF files in the wheels of other projects.

gymnasium and dm_control are installed for the tests; the others stand in the environments that
`sh .ci/versions.sh` makes, and nothing of them is imported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import mujoco

from evs.emulator.config import CameraConfig
from speed.panda import panda_model

VERSIONS = Path(__file__).parents[3] / "build" / "versions"


@dataclass(frozen=True)
class ForeignScene:
    """A model, and from where it is seen: one of its cameras, or a free one."""

    load: Callable[[], mujoco.MjModel]
    camera: str | CameraConfig = ""
    shape: float = 0.995
    """share of pixels in which evs and MuJoCo show the same thing, at least"""
    colour: float = 0.95
    """of these, the share with the same colour in even light, at least"""


def folder_of(package: str) -> Path:
    """Where an environment of .ci/versions.sh has the package of this name."""
    found = sorted(VERSIONS.glob(f"{package}/env/lib/python*/site-packages/{package}"))
    assert found, f"{package} is not here: sh .ci/versions.sh {package}"
    return found[0]


def _file(package: str, path: str) -> Callable[[], mujoco.MjModel]:
    assets = {"gymnasium_robotics": "envs/assets", "metaworld": "assets"}[package]
    return lambda: mujoco.MjModel.from_xml_path(str(folder_of(package) / assets / path))


def _installed(package: str, path: str) -> Callable[[], mujoco.MjModel]:
    def load() -> mujoco.MjModel:
        spec = find_spec(package)
        assert spec is not None, f"pip install {package}"
        assert spec.submodule_search_locations
        return mujoco.MjModel.from_xml_path(str(Path(spec.submodule_search_locations[0], path)))

    return load


def _around(x: float, y: float, z: float, distance: float, azimuth: float) -> CameraConfig:
    return CameraConfig(
        lookat=(x, y, z), distance=distance, azimuth=azimuth, elevation=-20.0, fovy=45.0
    )


SCENES = {
    "gymnasium ant": ForeignScene(
        _installed("gymnasium", "envs/mujoco/assets/ant.xml"),
        _around(0, 0, 0.6, 4.0, 120),
        # black and bright tiles that share a pixel: the mean of light here, of display codes there
        colour=0.68,
    ),
    "gymnasium humanoid": ForeignScene(
        _installed("gymnasium", "envs/mujoco/assets/humanoid.xml"),
        _around(0, 0, 1.0, 3.5, 140),
        colour=0.59,
    ),
    "dm_control humanoid": ForeignScene(
        _installed("dm_control", "suite/humanoid.xml"), _around(0, 0, 1.0, 3.5, 140)
    ),
    "dm_control quadruped": ForeignScene(
        _installed("dm_control", "suite/quadruped.xml"),
        _around(0, 0, 0.5, 2.5, 130),
        # the rays of its range finders are not drawn here
        shape=0.915,
    ),
    "dm_control dog": ForeignScene(
        _installed("dm_control", "suite/dog.xml"), _around(0, 0, 0.5, 2.5, 130)
    ),
    "gymnasium-robotics hand": ForeignScene(
        _file("gymnasium_robotics", "hand/manipulate_block.xml"),
        _around(1.0, 0.9, 0.2, 0.7, 60),
        # the block and its target lie in the same place
        shape=0.985,
    ),
    "gymnasium-robotics Fetch": ForeignScene(
        _file("gymnasium_robotics", "fetch/pick_and_place.xml"), _around(1.0, 0.75, 0.6, 2.2, 140)
    ),
    "gymnasium-robotics kitchen": ForeignScene(
        _file("gymnasium_robotics", "kitchen_franka/kitchen_assets/kitchen_env_model.xml"),
        _around(0, 0.3, 1.8, 3.2, 90),
    ),
    "gymnasium-robotics door": ForeignScene(
        _file("gymnasium_robotics", "adroit_hand/adroit_door.xml"), _around(0, 0, 0.3, 1.6, 60)
    ),
    "robosuite Panda": ForeignScene(
        lambda: panda_model(folder_of("robosuite") / "models/assets"), "bench"
    ),
    "Metaworld basketball": ForeignScene(
        _file("metaworld", "sawyer_xyz/sawyer_basketball.xml"), "corner"
    ),
}


def in_even_light(scene: ForeignScene) -> mujoco.MjModel:
    """The scene's model under ambient light alone, without mirrors and glowing materials."""
    model = scene.load()
    model.light_active[:] = 0
    head = model.vis.headlight
    head.active, head.ambient[:], head.diffuse[:], head.specular[:] = 1, 1.0, 0.0, 0.0
    model.mat_reflectance[:] = 0
    model.mat_emission[:] = 0
    # the classic renderer shows images with an sRGB chunk darker than others of the same numbers
    model.tex_colorspace[:] = int(mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR)
    return model
