"""The physics of many worlds of one model, a tick at a time, on MuJoCo's own threads.

MuJoCo 4 steps many simulations in one call and gives the bytes of one after the other. A tick here
is that of `Physics`, and where MuJoCo gives up on a world, `Physics` itself says why.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64, I32
from evs.emulator.config import VisualConfig
from evs.emulator.world.cameras import BoundCamera, FreeCamera, ModelCamera
from evs.emulator.world.compat import SLEEP
from evs.emulator.world.deformables import Deformables
from evs.emulator.world.encoders import Measurements
from evs.emulator.world.lights import active_lights
from evs.emulator.world.physics import FATAL, SILENT, Physics, UnstableError
from evs.emulator.world.tendons import Strands
from evs.emulator.world.visual import DEFAULT, visible_geoms, visible_sites

I64 = npt.NDArray[np.int64]

_FATAL = [*FATAL]

_CALLBACKS = [getattr(mujoco, name) for name in dir(mujoco) if name.startswith("get_mjcb_")]


def why_not_batched(model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> str:
    """Why MuJoCo cannot step many worlds of this model in one call, as a reason; "": it can."""
    if importlib.util.find_spec("mujoco.batch") is None:
        return f"MuJoCo {mujoco.__version__} has no mujoco.batch; 4.0 and later do"
    if model.opt.enableflags & SLEEP:
        return "the model puts bodies to sleep"
    if len(Deformables(model, visual)):
        return "the model has skins or flexes"
    if len(Strands(model, visual)):
        return "the model shows tendons, ropes or slider-cranks"
    return ""


def has_callbacks() -> bool:
    """Whether functions are installed that MuJoCo calls, which a batch may not take."""
    return any(get() is not None for get in _CALLBACKS)


class PhysicsBatch:
    """Steps the physics of many worlds of one model, and finds where everything is.

    Between `load` and `settle` a world's state is here: a row of `state`.
    """

    def __init__(self, worlds: Sequence[Physics], threads: int, stage: int = 0) -> None:
        """Make room for the worlds; nothing is loaded yet.

        Args:
            worlds: Of one model, or of copies of it with other values, with the same ticks.
            threads: Worlds to step at once; 0: one per core.
            stage: Up to which mjtStage fields are those of the end of a tick; at least poses are.
        """
        from mujoco.batch import Batch, SimulationError

        self._stage = max(int(stage), mujoco.mjtStage.mjSTAGE_POS.value)
        self._error: type[Exception] = SimulationError
        self._worlds, self._substeps = worlds, worlds[0].substeps
        self._models = [world.model for world in worlds]
        self._differ: bool | None = False
        """whether worlds have models of their own; None: not known since one was loaded"""
        self._batch: Any = Batch(worlds[0].model, len(worlds), threads, persistent=True)
        self.state: F64 = self._batch.state
        """(n, mjSTATE_INTEGRATION) what the next tick of each world follows from"""
        self._before = np.zeros_like(self.state)
        self._ticks = np.zeros(len(worlds), np.int64)
        self._qpos, self._time = self.bind("qpos"), self.bind("time")
        count = len(worlds)
        self._places = [
            self.bind(name).reshape(count, -1) for name in ("qpos", "mocap_pos", "mocap_quat")
        ]
        self._measured = [
            (name, self.bind(field))
            for name, field in (
                ("position", "actuator_length"),
                ("velocity", "actuator_velocity"),
                ("sensordata", "sensordata"),
            )
        ]
        self.ctrl = self.bind("ctrl")
        """(n, nu) the controls of the next tick, which hold"""
        self._warnings: I32 = self._batch.warning[:, :, 1]

    def bind(self, name: str) -> Any:
        """(n, ...) the live array of a field of MjData, as it is after each tick."""
        return self._batch.bind(name)

    @property
    def t_us(self) -> I64:
        """(n,) simulated time of each world, us."""
        return self._ticks * self._substeps.tick_us

    @property
    def places(self) -> F64:
        """(n, k) what everything's place follows from, as in SnapshotTaker.places; a copy."""
        return np.concatenate(self._places, axis=1)

    def places_of(self, world: int) -> F64:
        """(k,) those of one world; a copy."""
        return np.concatenate([rows[world] for rows in self._places])

    def t_us_of(self, world: int) -> int:
        """Simulated time of one world, us."""
        return int(self._ticks[world]) * self._substeps.tick_us

    def measure(self, which: I32, into: Measurements) -> None:
        """Write down what some worlds measured at the end of their last tick."""
        for name, live in self._measured:
            rows: F64 = getattr(into, name)
            rows[which] = live[which].reshape(len(which), -1)

    def load(self, world: int) -> None:
        """From now on a world's state is here."""
        self._models[world] = self._worlds[world].model
        self._differ = None
        self.state[world] = self._worlds[world].state
        self._ticks[world] = self._worlds[world].tick

    def settle(self, world: int) -> None:
        """Put a world's state into its Physics, as if that had taken the ticks."""
        self._worlds[world].take(self.state[world], int(self._ticks[world]))

    def advance(self, which: I32) -> dict[int, UnstableError]:
        """Take a tick of some worlds.

        Args:
            which: (k,) int32 their numbers, in order.

        Returns:
            Why physics broke down, by world: its state is that of before the tick.
        """
        self._before[:] = self.state
        # counts begin at 1, so that MuJoCo prints nothing: see Physics
        self._warnings[:] = SILENT
        # the batch has a copy, and takes edits of models only so
        if self._differ is None:
            self._differ = any(model is not self._models[0] for model in self._models)
        self._batch.set_models(self._models if self._differ else self._models[0])
        everyone = len(which) == len(self._worlds)
        failed: set[int] = set()
        try:
            self._batch.step(None if everyone else which, self._substeps.count, self._stage)
        except self._error as reason:
            failed.update(getattr(reason, "ids", which).tolist())
        self._ticks[which] += 1
        # counted, not accumulated
        self._time[which] = self._ticks[which] * self._substeps.tick_us * 1e-6
        sound = (self._warnings[:, _FATAL] == SILENT).all(axis=1)
        sound &= np.isfinite(self._qpos).all(axis=1)
        if not sound.all():
            failed.update(set(np.flatnonzero(~sound).tolist()) & set(which.tolist()))
        return {world: self._explain(world) for world in sorted(failed)}

    def _explain(self, world: int) -> UnstableError:
        """Put a world back before the tick, and let its Physics say what goes wrong in it."""
        self.state[world] = self._before[world]
        self._ticks[world] -= 1
        self.settle(world)
        try:
            self._worlds[world].advance()
        except UnstableError as reason:
            return reason
        t_us = self.t_us_of(world)
        self.settle(world)
        return UnstableError(f"unstable at t = {t_us * 1e-6:.6f} s: MuJoCo gave up on the state")


class PoseBatch:
    """Where everything in many worlds is after a tick: rows as in SnapshotTaker, world by world."""

    def __init__(
        self,
        physics: PhysicsBatch,
        model: mujoco.MjModel,
        cameras: Sequence[Sequence[BoundCamera]],
        visual: VisualConfig = DEFAULT,
    ) -> None:
        """Find the rows.

        Args:
            physics: Whose ticks they follow.
            model: Of one world, and with other values of all; `why_not_batched` has no objection.
            cameras: Of each world, of the same kind.
            visual: Groups and flags that are seen.
        """
        worlds = len(physics.state)
        geoms, sites = visible_geoms(model, visual), visible_sites(model, visual)
        lights = active_lights(model)
        head, ids = int((lights < 0).sum()), lights[lights >= 0]
        # the headlight comes first; its row has a unit direction that nobody uses
        still = np.zeros((worlds, head, 3))
        self._gathered = [
            _Gathered(
                worlds, 3, (physics.bind("geom_xpos"), geoms), (physics.bind("site_xpos"), sites)
            ),
            _Gathered(
                worlds, 9, (physics.bind("geom_xmat"), geoms), (physics.bind("site_xmat"), sites)
            ),
            _Gathered(worlds, 3, (still, np.arange(head)), (physics.bind("light_xpos"), ids)),
            _Gathered(
                worlds, 3, (still - (0, 0, 1), np.arange(head)), (physics.bind("light_xdir"), ids)
            ),
        ]
        self.geom_pos, self.geom_mat, self.light_pos, self.light_dir = (
            part.all for part in self._gathered
        )
        self.camera_pos = np.zeros((worlds, len(cameras[0]), 3))
        """(n, cameras, 3)"""
        self.camera_mat = np.zeros((worlds, len(cameras[0]), 9))
        """(n, cameras, 9)"""
        self._cameras = [*cameras]
        names = ("xpos", "xmat", "cam_xpos", "cam_xmat")
        self._frames = {name: physics.bind(name) for name in names}

    def load(self, world: int, cameras: Sequence[BoundCamera]) -> None:
        """From now on these are the cameras of a world."""
        self._cameras[world] = cameras
        for place, camera in enumerate(cameras):
            if isinstance(camera.mount, FreeCamera):
                # it stands still
                self.camera_pos[world, place] = camera.mount.fixed.pos
                self.camera_mat[world, place] = camera.mount.fixed.mat

    def update(self, which: I32, t_us: I64) -> None:
        """Take them after a tick.

        Args:
            which: (k,) int32 the worlds that took it.
            t_us: (n,) its end in each world, us.
        """
        for part in self._gathered:
            part.update()
        frames = self._frames
        for place, camera in enumerate(self._cameras[0]):
            mount = camera.mount
            if isinstance(mount, ModelCamera):
                self.camera_pos[:, place] = frames["cam_xpos"][:, mount.camera]
                self.camera_mat[:, place] = frames["cam_xmat"][:, mount.camera]
            elif not isinstance(mount, FreeCamera):
                for world in which.tolist():
                    here = SimpleNamespace(**{name: rows[world] for name, rows in frames.items()})
                    pose = self._cameras[world][place].mount.pose(here, int(t_us[world]))
                    self.camera_pos[world, place], self.camera_mat[world, place] = (
                        pose.pos,
                        pose.mat,
                    )


class _Gathered:
    """Columns of live (n, ...) arrays, side by side; where they are all of one, that array."""

    def __init__(self, worlds: int, width: int, *parts: tuple[Any, Any]) -> None:
        """Find where they go.

        Args:
            worlds: n.
            width: Of a row.
            *parts: (n, m, width) a live array and which of its rows.
        """
        used = [(live.reshape(worlds, -1, width), rows) for live, rows in parts if len(rows)]
        self._parts: list[tuple[slice, F64, Any]] = []
        if len(used) == 1 and np.array_equal(used[0][1], np.arange(used[0][0].shape[1])):
            self.all: F64 = used[0][0]
            return
        self.all = np.zeros((worlds, sum(len(rows) for _, rows in used), width))
        begin = 0
        for live, rows in used:
            self._parts.append((slice(begin, begin + len(rows)), live, rows))
            begin += len(rows)

    def update(self) -> None:
        """Take the rows as they are now."""
        for where, live, rows in self._parts:
            self.all[:, where] = live[:, rows]
