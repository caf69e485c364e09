"""A camera whose picture one near geom fills: it stands behind its own housing, or inside it."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import CameraPose, GroundTruth, SceneSnapshot
from evs.emulator.camera.view import Viewpoint
from evs.emulator.world import MjModel, geom_label

NEAR_M, NEAR_EXTENTS = 0.05, 0.05
"""how far away a cover may be, m, and as a share of the model's extent"""


def may_be_covered(
    world: MjModel, viewpoint: Viewpoint, snapshot: SceneSnapshot, pose: CameraPose
) -> bool:
    """Whether the bounds of a geom are near enough: only then is a picture of ids worth its time.

    Args:
        world: The model.
        viewpoint: The camera's.
        snapshot: Where the geoms are.
        pose: The camera's.
    """
    geoms = viewpoint.scene.geom_id >= 0
    away = snapshot.geom_pos[geoms] - pose.pos
    # a plane has no radius: its distance counts
    radius = world.geom_rbound[viewpoint.scene.geom_id[geoms]]
    normal = snapshot.geom_mat[geoms].reshape(-1, 3, 3)[:, :, 2]
    gap = np.where(
        radius > 0.0, np.linalg.norm(away, axis=1) - radius, np.abs((away * normal).sum(1))
    )
    return bool((gap < _limit_m(viewpoint)).any())


def _limit_m(viewpoint: Viewpoint) -> float:
    return min(NEAR_M, NEAR_EXTENTS * viewpoint.scene.extent_m)


def covered_by(
    world: MjModel, viewpoint: Viewpoint, truth: GroundTruth, name: str
) -> tuple[str, ...]:
    """One line that names the geom that fills the whole picture from a few cm away, and the fix.

    Args:
        world: The model.
        viewpoint: The camera's.
        truth: What it sees.
        name: Of the camera.

    Returns:
        () where there is none.
    """
    geom, limit_m = int(truth.geom_id.flat[0]), _limit_m(viewpoint)
    farthest_m = float(np.max(truth.distance))
    if geom < 0 or not farthest_m < limit_m or (truth.geom_id != geom).any():
        return ()
    near_m = viewpoint.bound.model.near_m
    line = (
        f"camera '{name}': geom '{geom_label(world, geom)}', at most {1e3 * farthest_m:.3g} mm "
        f"away, fills the picture; a camera behind its own housing needs a near plane (camera."
        f"near_m, now {near_m:.3g}) beyond it, the geom's group hidden (scene.visual.geomgroup), "
        "or another place"
    )
    return (line,)
