"""Viewpoint: a camera in its place in a scene. Lit: the light that falls on it at one instant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import F32, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.world import BoundCamera


class Viewpoint(NamedTuple):
    """A camera in its place, and what renders what it sees. Another one where the scene is."""

    bound: BoundCamera
    scene: SceneModel
    renderer: Renderer

    def follows(self, other: Viewpoint) -> bool:
        """Whether a snapshot for `other` has the same geoms, so that their motion can be seen."""
        ours, theirs = self.scene, other.scene
        return ours is theirs or (
            np.array_equal(ours.geom_id, theirs.geom_id) and ours.deforming == theirs.deforming
        )


class Lit(NamedTuple):
    """One instant, and what a camera sees of it."""

    snapshot: SceneSnapshot
    pose: CameraPose
    """where the camera was"""
    luminance: F32
    """(h, w) float32, linear"""
    viewpoint: Viewpoint
    """whose light it is"""
    traced_fraction: float
    """share of the pixels that had to be traced for it, 0 ... 1"""
