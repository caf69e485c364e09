"""Physics: one tick after the other, and an error where MuJoCo gives up on the state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.world.compat import actuator_of
from evs.emulator.world.model import name_of, one_line
from evs.emulator.world.physics_state import (
    STATE,
    Arrays,
    check_physics,
    put_physics,
    save_physics,
    state_of,
)
from evs.emulator.world.ticks import Substeps, fill_tick
from evs.emulator.world.unstable import (
    UnstableError,
    check_positions,
    joint_of_position,
    joint_place,
)
from evs.msgs import EvsError

Warnings = mujoco.mjtWarning
FATAL = {
    int(Warnings.mjWARN_BADQPOS): "bad position (NaN, infinite or huge)",
    int(Warnings.mjWARN_BADQVEL): "bad velocity (NaN, infinite or huge)",
    int(Warnings.mjWARN_BADQACC): "bad acceleration (NaN, infinite or huge)",
    int(Warnings.mjWARN_BADCTRL): "bad control (NaN, infinite or huge)",
    int(Warnings.mjWARN_CONTACTFULL): "contact buffer full",
    int(Warnings.mjWARN_CNSTRFULL): "constraint buffer full",
}
"""The warnings after which the motion is not the model's any more."""

_FATAL = np.array([*FATAL])

MAX_TICKS = 2**52
"""1 us each: 142 years"""

SILENT = 1
"""MuJoCo prints a warning whose count is 0. Counts begin here; the error reports it instead."""

_SILENT = [SILENT] * len(FATAL)


class Physics:
    """A model and its state, advanced in exact ticks. The model is changed: give it a copy."""

    def __init__(self, model: mujoco.MjModel, tick_us: int, keyframe: int = -1) -> None:
        """Fit the time step to the tick, and make the data.

        Args:
            model: Changed in place.
            tick_us: Length of a tick, us.
            keyframe: Id of the keyframe to start from; -1: qpos0.

        Raises:
            EvsError: The tick cannot be filled, or the state does not fit into memory.
        """
        self.substeps: Substeps = fill_tick(tick_us, model.opt.timestep)
        model.opt.timestep = self.substeps.timestep_s
        # a reset would put time and robot back to their beginning without a word
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.model = model
        try:
            self.data = mujoco.MjData(model)
        except (mujoco.FatalError, MemoryError) as reason:
            raise EvsError(f"the model's state does not fit: {one_line(reason)}") from None
        self._before = np.zeros(mujoco.mj_stateSize(model, STATE))
        # MuJoCo's own memory, not a copy
        self._warnings = self.data.warning.number
        self.reset(keyframe)

    def reset(self, keyframe: int = -1) -> None:
        """Go back to the beginning.

        Args:
            keyframe: Id of the keyframe to start from; -1: qpos0.
        """
        model = self.model
        mujoco.mj_resetData(model, self.data)
        if keyframe >= 0:
            mujoco.mj_resetDataKeyframe(model, self.data, keyframe)
        self.data.time = 0.0
        # poses to read before the first step; they follow from qpos and change no state
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)
        mujoco.mj_camlight(model, self.data)
        self.tick = 0

    @property
    def t_us(self) -> int:
        """Simulated time, us: ticks times their length."""
        return self.tick * self.substeps.tick_us

    @property
    def state(self) -> F64:
        """(n,) everything that the next tick follows from, as mjSTATE_INTEGRATION; a copy."""
        return state_of(self.model, self.data)

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that `restoring` takes back."""
        return {**save_physics(self.model, self.data), "tick": np.array(self.tick, np.int64)}

    def restoring(self, saved: Arrays) -> Callable[[], None]:
        """Checks what `save` gave; what comes back puts it in place. Raises EvsError."""
        check_physics(self.model, self.data, saved)
        tick = saved.get("tick")
        if tick is None or tick.dtype != np.int64 or tick.shape or not 0 <= tick <= MAX_TICKS:
            raise EvsError("saved state is damaged: the number of ticks is invalid; save it again")
        number = int(tick)

        def put() -> None:
            put_physics(self.model, self.data, saved)
            self.tick = number

        return put

    def advance(self) -> None:
        """One tick. Raises UnstableError; the state then is again that of the tick before."""
        mujoco.mj_getState(self.model, self.data, self._before, STATE)
        try:
            self._advance()
        except UnstableError:
            mujoco.mj_setState(self.model, self.data, self._before, STATE)
            raise

    def _advance(self) -> None:
        data, counts = self.data, self._warnings
        counts[_FATAL] = SILENT
        for _ in range(self.substeps.count):
            t_s = data.time
            try:
                mujoco.mj_step(self.model, data)
            except mujoco.FatalError as reason:
                raise UnstableError(f"unstable at t = {t_s:.6f} s: {one_line(reason)}") from None
            if counts[_FATAL].tolist() != _SILENT:
                warning = next(one for one in FATAL if counts[one] != SILENT)
                raise self._unstable(warning, t_s)
        # nothing could be drawn of what is not finite
        check_positions(self.model, data, self.t_us + self.substeps.tick_us)
        self.tick += 1
        # counted, not accumulated
        data.time = self.t_us * 1e-6

    def _unstable(self, warning: int, t_s: float) -> UnstableError:
        info = int(self.data.warning[warning].lastinfo)
        where = self._place(warning, info)
        if warning in (Warnings.mjWARN_CONTACTFULL, Warnings.mjWARN_CNSTRFULL):
            remedy = "give the model more memory: <size memory=.../>"
        else:
            remedy = "try a shorter tick, softer contacts or smaller controls"
        return UnstableError(
            f"unstable at t = {t_s:.6f} s: {FATAL[warning]} at {where}; MuJoCo: "
            f"{one_line(mujoco.mju_warningText(warning, info))} ({remedy})"
        )

    def _place(self, warning: int, info: int) -> str:
        """The joint and body, or the actuator, that a warning is about."""
        model = self.model
        if warning == Warnings.mjWARN_BADCTRL:
            return f"actuator '{self._actuator(info)}'"
        if warning == Warnings.mjWARN_BADQPOS:
            return joint_place(model, joint_of_position(model, info))
        if warning in (Warnings.mjWARN_BADQVEL, Warnings.mjWARN_BADQACC):
            return joint_place(model, int(model.dof_jntid[info]))
        return self._most_touched()

    def _actuator(self, control: int) -> str:
        """The actuator that owns a control."""
        index = actuator_of(self.model, control)
        return name_of(self.model, mujoco.mjtObj.mjOBJ_ACTUATOR, index)

    def _most_touched(self) -> str:
        """The body, the world aside, with the most contacts."""
        bodies = self.model.geom_bodyid
        geoms = self.data.contact.geom[: self.data.ncon].ravel()
        touched = Counter(int(bodies[geom]) for geom in geoms if geom >= 0 and bodies[geom] > 0)
        if not touched:
            return "a body that could not be told: no contact fitted"
        body, count = touched.most_common(1)[0]
        name = name_of(self.model, mujoco.mjtObj.mjOBJ_BODY, body)
        return f"body '{name}' ({count} of {self.data.ncon} contacts)"
