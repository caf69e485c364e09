"""What of a model can move at all, whatever its controls are: bodies, lights, a camera."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.world.cameras import (
    BoundCamera,
    FreeCamera,
    ModelCamera,
    ShakenCamera,
    TravellingCamera,
)
from evs.emulator.world.compat import SLEEP
from evs.emulator.world.lights import active_lights
from evs.emulator.world.physics import moving_bodies

FIXED = int(mujoco.mjtCamLight.mjCAMLIGHT_FIXED)


@dataclass(frozen=True)
class Mobility:
    """What can move, by the model's joints, mocap bodies and tracking modes."""

    bodies_moving: int
    bodies_still: int
    lights_moving: tuple[str, ...]
    """names of those that shine; the headlight goes with the camera"""
    skins: int
    flexes: int
    camera_moves: str
    """why the camera can move; empty: it stands still"""
    sleeping: bool
    """whether MuJoCo puts bodies that rest to sleep"""


def mobility_of(model: mujoco.MjModel, bound: BoundCamera) -> Mobility:
    """What of the model, and whether the camera, can move."""
    moving = moving_bodies(model)
    lights = active_lights(model)
    lights = lights[lights >= 0]
    moves = _moves(
        moving, model.light_bodyid[lights], model.light_mode[lights],
        model.light_targetbodyid[lights],
    )  # fmt: skip
    named = [
        mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_LIGHT, int(light)) or str(int(light))
        for light in lights[moves]
    ]
    return Mobility(
        bodies_moving=int(moving.sum()),
        bodies_still=int((~moving).sum()),
        lights_moving=tuple(named),
        skins=int(model.nskin),
        flexes=int(model.nflex),
        camera_moves=_camera_moves(model, moving, bound),
        sleeping=bool(model.opt.enableflags & SLEEP),
    )


def _moves(
    moving: npt.NDArray[np.bool_],
    body: npt.NDArray[np.int32],
    mode: npt.NDArray[np.int32],
    target: npt.NDArray[np.int32],
) -> npt.NDArray[np.bool_]:
    """Of cameras or lights: carried by a body that moves, or turned after one."""
    follows = (mode != FIXED) & (target >= 0) & moving[np.maximum(target, 0)]
    # centres of mass move with whatever moves
    tracks = np.isin(mode, [int(mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM)]) & moving.any()
    return np.asarray(moving[body] | follows | tracks, np.bool_)


def _camera_moves(model: mujoco.MjModel, moving: npt.NDArray[np.bool_], bound: BoundCamera) -> str:
    mount = bound.mount
    if isinstance(mount, ShakenCamera):
        return "it shakes"
    if isinstance(mount, TravellingCamera):
        return f"it goes through a trajectory of {mount.trajectory.seconds:.3g} s"
    if isinstance(mount, FreeCamera):
        return ""
    if isinstance(mount, ModelCamera):
        camera = [mount.camera]
        body = int(model.cam_bodyid[mount.camera])
        moves = _moves(
            moving, model.cam_bodyid[camera], model.cam_mode[camera], model.cam_targetbodyid[camera]
        )[0]
        if moves and not moving[body]:
            return "it follows a body that moves"
    else:
        body, moves = mount.body, moving[mount.body]
    if not moves:
        return ""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) or str(body)
    return f"body '{name}' carries it"
