"""Generate training scenes: MJCF text that depends only on a seed and a number."""

from evs_lab.training.scenes.scene import CAMERA, KINDS, START, TrainingScene, make_scene

__all__ = ["CAMERA", "KINDS", "START", "TrainingScene", "make_scene"]
