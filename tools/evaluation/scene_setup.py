"""SceneSetup: a world to evaluate on, and how it is seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from evs.emulator.config import CameraConfig, FlickerConfig
from evs.emulator.world import MjModel


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
