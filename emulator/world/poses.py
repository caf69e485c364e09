"""Snapshots: where everything is at one instant, taken without touching the live data.

After mj_step the live data's geom and camera poses belong to the step's beginning. So the state
they follow from is copied into a private mjData, and the kinematics are done again there.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable

import mujoco
import numpy as np

from evs.emulator.scene import F64, I32, SceneSnapshot
from evs.emulator.world.cameras import BoundCamera
from evs.emulator.world.deforming import Deforming
from evs.emulator.world.extraction import visible_geoms
from evs.emulator.world.kinematics import update_poses
from evs.emulator.world.lights import active_lights
from evs.emulator.world.unstable import check_positions
from evs.msgs import EvsError


class Poser:
    """Takes snapshots of one model, for the cameras it was given.

    The rows of a snapshot are those of `extract_scene(model)`. Where the model's geoms or lights
    are changed later, make a new Poser.
    """

    def __init__(self, model: mujoco.MjModel, cameras: Iterable[BoundCamera] = ()) -> None:
        # with sleeping bodies on, the kinematics leave some poses out: a private model does without
        if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_SLEEP):
            model = copy.copy(model)
            model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._model = model
        self._data = mujoco.MjData(model)
        self._cameras = tuple(cameras)
        self._geoms = _rows(visible_geoms(model))
        lights = active_lights(model)
        self._lights = _rows(lights[lights >= 0])
        # the headlight comes first; its row has a unit direction that nobody uses
        self._headlight_pos, self._headlight_dir = np.zeros((2, int((lights < 0).sum()), 3))
        self._headlight_dir[:, 2] = -1.0
        # skins and flexes are given in the world's frame
        self._deforming = Deforming(model)
        self._world_pos = np.zeros((len(self._deforming), 3))
        self._world_mat = np.tile(np.eye(3).ravel(), (len(self._deforming), 1))

    def add_camera(self, camera: BoundCamera) -> None:
        """Snapshots from now on have this camera's pose too, as their last."""
        self._cameras += (camera,)

    def snapshot(self, data: mujoco.MjData, t_us: int, exposure_us: int = 0) -> SceneSnapshot:
        """Where everything is at `data.qpos` and the mocap poses. `data` is only read.

        In: exposure_us, over which flickering light is averaged.
        """
        model, own = self._model, self._data
        if data.qpos.shape != own.qpos.shape or data.mocap_pos.shape != own.mocap_pos.shape:
            raise EvsError(
                f"the data belongs to another model: it has {data.qpos.size} positions, this model "
                f"{own.qpos.size}; make the camera from the model that the data was made from"
            )
        check_positions(model, data, t_us)
        own.qpos[:] = data.qpos
        own.mocap_pos[:] = data.mocap_pos
        own.mocap_quat[:] = data.mocap_quat
        return self._look(t_us, exposure_us)

    @property
    def places(self) -> F64:
        """(n,) all that the last snapshot followed from: qpos, mocap_pos, mocap_quat. A copy."""
        own = self._data
        return np.concatenate([own.qpos, own.mocap_pos.ravel(), own.mocap_quat.ravel()])

    def again(self, places: F64, t_us: int, exposure_us: int = 0) -> SceneSnapshot:
        """The snapshot of that time, from its `places`. EvsError where they are of another model.

        The other arguments as of `snapshot`.
        """
        own = self._data
        bodies = len(own.mocap_pos)
        if places.shape != (own.qpos.size + 7 * bodies,) or not np.isfinite(places).all():
            raise EvsError("saved positions are of another model; restore them into their own")
        own.qpos[:], rest = places[: own.qpos.size], places[own.qpos.size :]
        own.mocap_pos[:] = rest[: 3 * bodies].reshape(bodies, 3)
        own.mocap_quat[:] = rest[3 * bodies :].reshape(bodies, 4)
        return self._look(t_us, exposure_us)

    def _look(self, t_us: int, exposure_us: int) -> SceneSnapshot:
        model, own = self._model, self._data
        update_poses(model, own)

        return SceneSnapshot(
            t_us,
            np.concatenate([own.geom_xpos[self._geoms], self._world_pos]),
            np.concatenate([own.geom_xmat[self._geoms], self._world_mat]),
            np.concatenate([self._headlight_pos, own.light_xpos[self._lights]]),
            np.concatenate([self._headlight_dir, own.light_xdir[self._lights]]),
            tuple(camera.mount.pose(own) for camera in self._cameras),
            self._deforming.vertices(own),
            exposure_us,
        )


def _rows(indices: I32) -> I32 | slice:
    """The same rows, as a slice where they follow each other: it is picked three times as fast."""
    first, end = (int(indices[0]), int(indices[-1]) + 1) if len(indices) else (0, 0)
    return slice(first, end) if np.array_equal(indices, np.arange(first, end)) else indices
