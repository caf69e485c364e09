"""Snapshots: where everything is at one instant, taken without touching the live data.

After mj_step the live data's geom and camera poses belong to the step's beginning. So the state
they follow from is copied into a private mjData, and the kinematics are done again there.
"""

from __future__ import annotations

import atexit
import copy
import threading
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from weakref import WeakSet

import mujoco
import numpy as np

from evs.emulator import _core
from evs.emulator.base.scene import F64, I32, SceneSnapshot
from evs.emulator.config import VisualConfig
from evs.emulator.world.cameras import BoundCamera
from evs.emulator.world.compat import SLEEP
from evs.emulator.world.deformables import Deformables
from evs.emulator.world.lights import active_lights
from evs.emulator.world.model import new_data
from evs.emulator.world.model_edits import arrays_of, pose_names
from evs.emulator.world.physics import check_positions, update_poses
from evs.emulator.world.tendons import Strands
from evs.emulator.world.visual import DEFAULT, visible_geoms, visible_sites
from evs.msgs import EvsError


class SnapshotTaker:
    """Takes snapshots of one model, for the cameras it was given.

    The rows of a snapshot are those of `extract_scene`, with the same groups and flags, as the
    model was when this was made or `fit` was called last. Poses are the model's as it is now.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        cameras: Iterable[BoundCamera] = (),
        visual: VisualConfig = DEFAULT,
    ) -> None:
        end_daemons_at_exit()
        self._given, self._visual = model, visual
        self._asleep: tuple[mujoco.MjModel, _core.Watch] | None = None
        self._data = new_data(self._awake())
        self.fit(cameras)

    def fit(self, cameras: Iterable[BoundCamera]) -> None:
        """Take rows and cameras anew, after geoms, lights or cameras of the model were edited."""
        own, self._cameras = self._data, tuple(cameras)
        self._model = model = self._awake()
        # all that a snapshot follows from, (n,) each: MuJoCo's own memory
        self._qpos, self._mocap_pos = own.qpos, own.mocap_pos.reshape(-1)
        self._mocap_quat = own.mocap_quat.reshape(-1)
        # skins and flexes are given in the world's frame
        self._deforming = Deformables(model, self._visual)
        count = len(self._deforming)
        still = np.zeros((count, 3)), np.tile(np.eye(3).ravel(), (count, 1))
        geoms, sites = visible_geoms(model, self._visual), visible_sites(model, self._visual)
        # tendons and ropes are found from what MuJoCo finds
        self._strands = strands = Strands(model, self._visual)
        every = np.arange(len(strands), dtype=np.int32)
        self._geom_pos = _Rows(
            (own.geom_xpos, geoms), still[0], (own.site_xpos, sites), (strands.pos, every)
        )
        self._geom_mat = _Rows(
            (own.geom_xmat, geoms), still[1], (own.site_xmat, sites), (strands.mat, every)
        )
        lights = active_lights(model)
        # the headlight comes first; its row has a unit direction that nobody uses
        head = np.zeros((int((lights < 0).sum()), 3))
        self._light_pos = _Rows(head, (own.light_xpos, lights[lights >= 0]))
        self._light_dir = _Rows(head - (0, 0, 1), (own.light_xdir, lights[lights >= 0]))

    def _awake(self) -> mujoco.MjModel:
        """The model; while it puts bodies to sleep, a private one that does not.

        With sleeping bodies the kinematics leave some poses out.
        """
        given = self._given
        if not given.opt.enableflags & SLEEP:
            self._asleep = None
            return given
        if self._asleep is None:
            model = copy.copy(given)
            model.opt.enableflags &= ~SLEEP
            self._asleep = model, _core.Watch(arrays_of(given, pose_names(given)))
        model, watch = self._asleep
        if watch.changed():
            watch.keep()
            for name in pose_names(given):
                getattr(model, name)[...] = getattr(given, name)
        return model

    def add_camera(self, camera: BoundCamera) -> None:
        """Snapshots from now on have this camera's pose too, as their last."""
        self._cameras += (camera,)

    def snapshot(self, data: mujoco.MjData, t_us: int, exposure_us: int = 0) -> SceneSnapshot:
        """Take a snapshot of where everything is at `data.qpos` and the mocap poses.

        Args:
            data: Only read.
            t_us: The instant, us.
            exposure_us: Flickering light is averaged over it, us.

        Raises:
            EvsError: The data is of another model.
        """
        qpos, mocap_pos = data.qpos, data.mocap_pos
        if qpos.size != self._qpos.size or mocap_pos.size != self._mocap_pos.size:
            raise EvsError(
                f"the data belongs to another model: it has {qpos.size} positions, this model "
                f"{self._qpos.size}; make the camera from the model that the data was made from"
            )
        check_positions(self._model, data, t_us)
        self._qpos[:] = qpos
        if mocap_pos.size:
            self._mocap_pos[:] = mocap_pos.reshape(-1)
            self._mocap_quat[:] = data.mocap_quat.reshape(-1)
        return self._take(t_us, exposure_us)

    @property
    def places(self) -> F64:
        """(n,) all that the last snapshot followed from: qpos, mocap_pos, mocap_quat. A copy."""
        return np.concatenate((self._qpos, self._mocap_pos, self._mocap_quat))

    def again(self, places: F64, t_us: int, exposure_us: int = 0) -> SceneSnapshot:
        """The snapshot of that time, from its `places`. EvsError where they are of another model.

        The other arguments as in `snapshot`.
        """
        ends = np.cumsum([self._qpos.size, self._mocap_pos.size, self._mocap_quat.size])
        if places.shape != (ends[-1],) or not np.isfinite(places).all():
            raise EvsError("saved positions are of another model; restore them into their own")
        self._qpos[:], self._mocap_pos[:], self._mocap_quat[:] = np.split(places, ends[:-1])
        return self._take(t_us, exposure_us)

    def _take(self, t_us: int, exposure_us: int) -> SceneSnapshot:
        end_here()
        model, own = self._awake(), self._data
        if model is not self._model:
            self.fit(self._cameras)
        update_poses(model, own)
        self._strands.update(own)
        return SceneSnapshot(
            t_us,
            self._geom_pos.copy(),
            self._geom_mat.copy(),
            self._light_pos.copy(),
            self._light_dir.copy(),
            tuple([camera.mount.pose(own, t_us) for camera in self._cameras]),
            self._deforming.vertices(own),
            exposure_us,
            self._strands.sizes.copy(),
        )


class _Rows:
    """Rows of arrays that MuJoCo writes, between rows that never change.

    A copy of all and one of each part, and no search for them: half of what np.concatenate takes
    for so few numbers.
    """

    def __init__(self, *parts: F64 | tuple[F64, I32]) -> None:
        """Find the parts.

        Args:
            *parts: (m, w) rows that never change, or (n, w) a live array and which of its rows.
        """
        rows: list[F64] = []
        self._parts: list[tuple[slice, F64, I32 | None]] = []
        for part in parts:
            if isinstance(part, tuple):
                live, indices = part
                begin = sum(map(len, rows))
                first, end = (int(indices[0]), int(indices[-1]) + 1) if len(indices) else (0, 0)
                follow = np.array_equal(indices, np.arange(first, end))
                # rows that follow each other are seen where they lie
                chosen = (live[first:end], None) if follow else (live, indices)
                if len(indices):
                    self._parts.append((slice(begin, begin + len(indices)), *chosen))
                rows.append(live[indices])
            else:
                rows.append(part)
        self._all = np.concatenate(rows)

    def copy(self) -> F64:
        """All of them as they are now."""
        taken = self._all.copy()
        for where, live, chosen in self._parts:
            taken[where] = live if chosen is None else live[chosen]
        return taken


# Up to 3.13 CPython stops a daemon thread wherever it next wants the interpreter's lock, and frames
# of MuJoCo's bindings on its stack crash the process then. At a snapshot it can be ended in peace.
_PATIENCE_S = 1.0
"""How long the exit waits for their next snapshots."""

_daemons: WeakSet[threading.Thread] = WeakSet()
"""those that have taken a snapshot"""
_exiting = threading.Event()


class _Here(threading.local):
    """What is known of a thread, from its first snapshot on."""

    def __init__(self) -> None:
        thread = threading.current_thread()
        self.is_daemon = thread.daemon
        if self.is_daemon:
            _daemons.add(thread)


_here = _Here()


@cache
def end_daemons_at_exit() -> None:
    """Let the interpreter's exit end them; what the user registers later is called before."""
    atexit.register(_end)


def end_here() -> None:
    """Before a snapshot: SystemExit if this thread is a daemon and the interpreter exits."""
    if _here.is_daemon and _exiting.is_set():
        raise SystemExit


def _end() -> None:
    _exiting.set()
    patience_s = _PATIENCE_S
    for thread in list(_daemons):
        # one that Python has not made cannot be joined
        with suppress(AssertionError, RuntimeError):
            thread.join(patience_s)
        # one that sleeps elsewhere is waited for once
        patience_s = 0.0 if thread.is_alive() else patience_s
