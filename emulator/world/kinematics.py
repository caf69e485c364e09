"""From joint positions to poses, and no further: no forces, no time."""

from __future__ import annotations

import mujoco


def update_poses(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute all poses that follow from `data.qpos`: bodies, geoms, cameras, lights, flexes."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    if model.nflex:
        mujoco.mj_flex(model, data)
