"""The recipe of training scenes: MJCF text from a seed and a number, and from nothing else."""

from evs_lab.training.scenes.scene import CAMERA, KINDS, START, TrainingScene, make_scene

__all__ = ["CAMERA", "KINDS", "START", "TrainingScene", "make_scene"]
