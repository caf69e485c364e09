"""The error that ends a run: the state is not the model's any more."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from evs.emulator.world.model import name_of
from evs.msgs import EvsError


class UnstableError(EvsError):
    """MuJoCo gave up on the state: when, with which warning, and at which joint or body."""


def joint_place(model: mujoco.MjModel, joint: int) -> str:
    """A joint and its body, by name."""
    body = name_of(model, mujoco.mjtObj.mjOBJ_BODY, int(model.jnt_bodyid[joint]))
    return f"joint '{name_of(model, mujoco.mjtObj.mjOBJ_JOINT, joint)}' of body '{body}'"


def joint_of_position(model: mujoco.MjModel, position: int) -> int:
    """The joint that owns qpos[position]."""
    return int((model.jnt_qposadr <= position).sum()) - 1


def check_positions(model: mujoco.MjModel, data: mujoco.MjData, t_us: int) -> None:
    """Raise UnstableError where data.qpos is not finite: nothing could be drawn of it."""
    positions = data.qpos
    # a NaN or an infinity anywhere is one in the sum of squares
    if math.isfinite(positions.dot(positions)):
        return
    finite = np.isfinite(positions)
    if finite.all():
        return
    joint = joint_of_position(model, int(np.flatnonzero(~finite)[0]))
    raise UnstableError(
        f"unstable at t = {t_us * 1e-6:.6f} s: bad position (NaN or infinite) at "
        f"{joint_place(model, joint)}"
    )
