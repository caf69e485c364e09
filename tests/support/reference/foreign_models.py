"""Robots and scenes that nobody here wrote, as MJCF files in the wheels of other projects.

gymnasium and dm_control are installed for the tests; the others are in the environments that
`sh .ci/versions.sh` makes, and nothing of them is imported.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import mujoco

from evs.emulator.config import CameraConfig
from speed.panda import panda_model

VERSIONS = Path(__file__).parents[3] / "build" / "versions"

ASSETS = {
    "gymnasium": "envs/mujoco/assets",
    "dm_control": "suite",
    "gymnasium_robotics": "envs/assets",
    "metaworld": "assets",
    "robosuite": "models/assets",
}
"""package -> its folder of MJCF files"""

INSTALLED = ("gymnasium", "dm_control")
"""packages that are installed for the tests; the others have environments of .ci/versions.sh"""


@dataclass(frozen=True)
class ForeignScene:
    """A model, and from where it is seen: one of its cameras, or a free one."""

    package: str
    file: str
    """in the package's folder of MJCF files"""
    camera: str | CameraConfig = ""
    shape: float = 0.995
    """share of pixels in which evs and MuJoCo show the same thing, at least"""
    colour: float = 0.95
    """of these, the share with the same colour in even light, at least"""

    def load(self) -> mujoco.MjModel:
        """Return the compiled model."""
        assets = _folder_of(self.package) / ASSETS[self.package]
        if self.package == "robosuite":
            # its arm and its table are files of their own
            return panda_model(assets)
        return mujoco.MjModel.from_xml_path(str(assets / self.file))


def _folder_of(package: str) -> Path:
    """Return the folder of a package."""
    if package in INSTALLED:
        spec = find_spec(package)
        assert spec is not None, f"pip install {package}"
        assert spec.submodule_search_locations
        return Path(spec.submodule_search_locations[0])
    found = sorted(VERSIONS.glob(f"{package}/env/lib/python*/site-packages/{package}"))
    assert found, f"{package} is not here: sh .ci/versions.sh {package}"
    return found[0]


def _around(x: float, y: float, z: float, distance: float, azimuth: float) -> CameraConfig:
    return CameraConfig(
        lookat=(x, y, z), distance=distance, azimuth=azimuth, elevation=-20.0, fovy=45.0
    )


SCENES = {
    "gymnasium ant": ForeignScene(
        "gymnasium",
        "ant.xml",
        _around(0, 0, 0.6, 4.0, 120),
        # black and bright tiles that share a pixel: the mean of light here, of display codes there
        colour=0.68,
    ),
    "gymnasium humanoid": ForeignScene(
        "gymnasium",
        "humanoid.xml",
        _around(0, 0, 1.0, 3.5, 140),
        colour=0.59,
    ),
    "dm_control humanoid": ForeignScene("dm_control", "humanoid.xml", _around(0, 0, 1.0, 3.5, 140)),
    "dm_control quadruped": ForeignScene(
        "dm_control",
        "quadruped.xml",
        _around(0, 0, 0.5, 2.5, 130),
        # the rays of its range finders are not drawn here
        shape=0.915,
    ),
    "dm_control dog": ForeignScene("dm_control", "dog.xml", _around(0, 0, 0.5, 2.5, 130)),
    "gymnasium-robotics hand": ForeignScene(
        "gymnasium_robotics",
        "hand/manipulate_block.xml",
        _around(1.0, 0.9, 0.2, 0.7, 60),
        # the block and its target lie in the same place
        shape=0.985,
    ),
    "gymnasium-robotics Fetch": ForeignScene(
        "gymnasium_robotics", "fetch/pick_and_place.xml", _around(1.0, 0.75, 0.6, 2.2, 140)
    ),
    "gymnasium-robotics kitchen": ForeignScene(
        "gymnasium_robotics",
        "kitchen_franka/kitchen_assets/kitchen_env_model.xml",
        _around(0, 0.3, 1.8, 3.2, 90),
    ),
    "gymnasium-robotics door": ForeignScene(
        "gymnasium_robotics", "adroit_hand/adroit_door.xml", _around(0, 0, 0.3, 1.6, 60)
    ),
    "robosuite Panda": ForeignScene("robosuite", "robots/panda/robot.xml", "bench"),
    "Metaworld basketball": ForeignScene("metaworld", "sawyer_xyz/sawyer_basketball.xml", "corner"),
}


def in_even_light(scene: ForeignScene) -> mujoco.MjModel:
    """Return the scene's model under ambient light alone, without mirrors and glowing materials."""
    model = scene.load()
    model.light_active[:] = 0
    head = model.vis.headlight
    head.active, head.ambient[:], head.diffuse[:], head.specular[:] = 1, 1.0, 0.0, 0.0
    model.mat_reflectance[:] = 0
    model.mat_emission[:] = 0
    # the classic renderer shows images with an sRGB chunk darker than others of the same numbers
    model.tex_colorspace[:] = int(mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR)
    return model
