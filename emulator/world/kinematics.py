"""From joint positions to poses, and no further: no forces, no time; what moves, where down is."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64


def update_poses(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute all poses that follow from `data.qpos`.

    Those of bodies, geoms, sites, cameras, lights, flexes and tendons.
    """
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    if model.nflex:
        mujoco.mj_flex(model, data)
    if model.ntendon:
        mujoco.mj_tendon(model, data)


def moving_bodies(model: mujoco.MjModel) -> npt.NDArray[np.bool_]:
    """(nbody,) True where a joint or a mocap body can move it."""
    carried = model.body_mocapid[model.body_rootid] >= 0
    return np.asarray((model.body_weldid != 0) | carried, np.bool_)


def gravity_of(model: mujoco.MjModel) -> F64:
    """(3,) the acceleration of free fall, m/s^2, in the world, as the model has it now."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY):
        return np.zeros(3)
    return np.array(model.opt.gravity, np.float64)
