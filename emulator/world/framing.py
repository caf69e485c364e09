"""What a free camera should have in its picture: what moves, not the floor it stands on."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64
from evs.emulator.world.controls import home_keyframe
from evs.emulator.world.kinematics import moving_bodies, update_poses
from evs.emulator.world.materials import geom_rgba, is_shown


def robot_box(model: mujoco.MjModel) -> tuple[F64, F64] | None:
    """(3,), (3,) lowest and highest corner, m, of what moves; None: the world's body has it all.

    Of whole trees of bodies that have a joint or are mocap, an arm's fixed base too, else of all
    bodies but the world; where they are at the keyframe `home`, else at qpos0. What is not shown
    does not count, nor does a plane.
    """
    roots = np.unique(model.body_rootid[moving_bodies(model)])
    robots = np.isin(model.body_rootid, roots)
    others = np.arange(model.nbody) > 0
    return next((box for bodies in (robots, others) if (box := _box(model, bodies))), None)


def _box(model: mujoco.MjModel, bodies: npt.NDArray[np.bool_]) -> tuple[F64, F64] | None:
    """Of all that these bodies, (nbody,), carry."""
    geoms = [
        geom
        for geom in range(model.ngeom)
        if bodies[model.geom_bodyid[geom]]
        and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE
        and is_shown(model.geom_group[geom], geom_rgba(model, geom))
    ]
    deforms = bool(model.nskin or model.nflex)
    if not geoms and not (deforms and bodies.any()):
        return None
    data = mujoco.MjData(model)
    home = home_keyframe(model)
    if home >= 0:
        mujoco.mj_resetDataKeyframe(model, data, home)
    update_poses(model, data)
    turn = data.geom_xmat[geoms].reshape(-1, 3, 3)
    boxes = model.geom_aabb[geoms].reshape(-1, 6)
    middle = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", turn, boxes[:, :3])
    half = np.einsum("gij,gj->gi", np.abs(turn), boxes[:, 3:])
    # the vertices of skins and flexes lie at their bodies
    carried = data.xpos[bodies] if deforms else np.zeros((0, 3))
    low = np.concatenate([middle - half, carried]).min(axis=0)
    high = np.concatenate([middle + half, carried]).max(axis=0)
    return (low, high) if np.isfinite([low, high]).all() else None
