"""The world: a MuJoCo model, its physics in exact ticks, and what a renderer sees of it.

The only folder that imports mujoco.
"""

from evs.emulator.world.cameras import BoundCamera, bind_camera
from evs.emulator.world.extraction import extract_scene, visible_geoms
from evs.emulator.world.loading import Scene, load_model
from evs.emulator.world.poses import Poser

__all__ = [
    "BoundCamera",
    "Poser",
    "Scene",
    "bind_camera",
    "extract_scene",
    "load_model",
    "visible_geoms",
]
