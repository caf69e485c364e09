"""Stage: a world to film, and how."""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.config import CameraConfig, FlickerConfig
from evs.emulator.world import MjModel


@dataclass(frozen=True)
class Stage:
    """A world to film."""

    name: str
    model: MjModel
    view: CameraConfig
    """from where it is seen"""
    camera: str = ""
    """or through which of the model's cameras"""
    soft: bool = False
    """whether a lamp has a size, so that shadows are soft"""
    keyframe: str = ""
    """of the model, to start from"""
    warm_ticks: int = 100
    """ms that the scene has moved before the first picture"""
    stands: bool = False
    """the camera stays where it is at first, however the scene would move it"""
    bounces: int = 2
    flicker: tuple[FlickerConfig, ...] = ()
