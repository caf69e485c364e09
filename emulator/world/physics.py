"""Physics: exact ticks, one after the other, and an error where MuJoCo gives up on the state.

A tick is filled with whole steps. The state is mjSTATE_INTEGRATION, and who sleeps, which is no
part of it. Kinematics, from joint positions to poses without forces or time, follow at the end.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco import MjData, MjModel

from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F64
from evs.emulator.world.compat import SLEEP, actuator_of
from evs.emulator.world.model import name_of, new_data, one_line
from evs.msgs import EvsError

MAX_STEPS = 1_000_000
"""in a tick; more is a slip of the keyboard"""


@dataclass(frozen=True)
class Substeps:
    """How a tick is filled, and what that did to the model's time step."""

    tick_us: int
    """length of a tick, us"""
    count: int
    """physics steps a tick"""
    timestep_s: float
    """length of each of them, s"""
    model_timestep_s: float
    """the model's own, s"""

    def __str__(self) -> str:
        """The choice as a sentence."""
        wanted, taken = f"{self.model_timestep_s * 1e3:g} ms", f"{self.timestep_s * 1e3:g} ms"
        steps = "1 physics step" if self.count == 1 else f"{self.count} physics steps"
        reason = "as the model has it" if self.kept else f"the model asks for {wanted}{self._key()}"
        return f"{steps} of {taken} in each tick of {self.tick_us / 1e3:g} ms ({reason})"

    @property
    def kept(self) -> bool:
        """Whether the model's time step is as it was."""
        return math.isclose(self.timestep_s, self.model_timestep_s, rel_tol=1e-9)

    def _key(self) -> str:
        """The nearest tick that keeps the model's step, as a key; "" where there is none."""
        model_us = self.model_timestep_s * 1e6
        if not math.isclose(model_us, round(model_us), rel_tol=1e-9) or model_us < 0.5:
            return ""
        steps = max(1, round(self.tick_us / model_us))
        return f"; scene.tick_us={steps * round(model_us)} keeps it"


def fill_tick(tick_us: int, model_timestep_s: float) -> Substeps:
    """The fewest equal steps that fill a tick and are no longer than the model's own.

    Raises EvsError where the tick is not a positive whole number of microseconds.
    """
    if isinstance(tick_us, bool | str) or not float(tick_us).is_integer() or tick_us <= 0:
        raise EvsError(
            f"scene.tick_us is {tick_us}: a tick is a positive whole number of microseconds, "
            "for example 1000"
        )
    if not 0.0 < model_timestep_s < math.inf:
        raise EvsError(
            f"the model's timestep is {model_timestep_s} s: it must be over 0 and finite"
        )

    # 1 ms over 0.1 ms is a little over 10 in floating point, and still 10
    tick_s = int(tick_us) * 1e-6
    if tick_s / model_timestep_s > MAX_STEPS * (1.0 + 1e-9):
        raise EvsError(
            f"the model's timestep is {model_timestep_s:g} s: a tick of {tick_us} us would take "
            f"{tick_s / model_timestep_s:.3g} steps; give <option timestep=.../> of "
            f"{tick_s / MAX_STEPS:g} s or more, or a shorter scene.tick_us"
        )
    count = max(1, math.ceil(tick_s / model_timestep_s * (1.0 - 1e-9)))
    return Substeps(int(tick_us), count, tick_s / count, float(model_timestep_s))


class UnstableError(EvsError):
    """The physics became unstable; the message has time, warning, and joint or body."""


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


STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""Everything that the next step follows from, where nobody sleeps."""

_COUNTS = ("nbody_awake", "nparent_awake", "ntree_awake", "nv_awake")
_FLAGS = {"body_awake": "nbody", "tree_awake": "ntree"}
_INDICES = {"body_awake_ind": "nbody", "parent_awake_ind": "nbody", "dof_awake_ind": "nv"}
"""field of mjData -> what its values count"""

Arrays = Mapping[str, np.ndarray[Any, Any]]


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> F64:
    """(n,) mjSTATE_INTEGRATION, a copy."""
    out = np.zeros(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, out, STATE)
    return out


def save_physics(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, np.ndarray[Any, Any]]:
    """What check_physics and put_physics take back."""
    saved: dict[str, np.ndarray[Any, Any]] = {"state": state_of(model, data)}
    if model.opt.enableflags & SLEEP:
        for name in (*_COUNTS, *_FLAGS, *_INDICES, "tree_asleep"):
            saved[name] = np.array(getattr(data, name), np.int32)
    return saved


def check_physics(model: mujoco.MjModel, data: mujoco.MjData, saved: Arrays) -> None:
    """EvsError where these arrays are not of this model."""
    expected = save_physics(model, data)
    fits = all(
        name in saved and saved[name].dtype == array.dtype and saved[name].shape == array.shape
        for name, array in expected.items()
    )
    if fits and "tree_asleep" in expected:
        # MuJoCo goes by these numbers without a look
        fits = _within(saved["tree_asleep"], -(2**31), model.ntree) and all(
            _within(saved[name], 0, data_limit + 1)
            for name, data_limit in (
                ("nbody_awake", model.nbody),
                ("nparent_awake", model.nbody),
                ("ntree_awake", model.ntree),
                ("nv_awake", model.nv),
            )
        )
        fits = fits and all(_within(saved[name], -1, 2) for name in _FLAGS)
        fits = fits and all(
            _within(saved[name], 0, max(1, int(getattr(model, limit))))
            for name, limit in _INDICES.items()
        )
    if not fits:
        raise EvsError("saved physics do not fit the model: restore them into their own world")


def put_physics(model: mujoco.MjModel, data: mujoco.MjData, saved: Arrays) -> None:
    """Put the state in place; nothing of what was there before stays behind."""
    mujoco.mj_resetData(model, data)
    mujoco.mj_setState(model, data, saved["state"], STATE)
    # what a caller may read before the next step
    mujoco.mj_forward(model, data)
    # and whatever forward has moved on
    mujoco.mj_setState(model, data, saved["state"], STATE)
    if "tree_asleep" in saved:
        for name in _COUNTS:
            setattr(data, name, int(saved[name]))
        for name in (*_FLAGS, *_INDICES, "tree_asleep"):
            getattr(data, name)[:] = saved[name]


def _within(values: np.ndarray[Any, Any], low: int, end: int) -> bool:
    return bool(((values >= low) & (values < end)).all())


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

RESETTING = np.array(
    [Warnings.mjWARN_BADQPOS, Warnings.mjWARN_BADQVEL, Warnings.mjWARN_BADQACC], np.int64
)
"""The warnings after which MuJoCo resets the data by itself, where autoreset is on."""

MAX_TICKS = 2**52
"""1 us each: 142 years"""

SILENT = 1
"""MuJoCo prints a warning whose count is 0. Counts begin here; the error reports it instead."""

_SILENT = [SILENT] * len(FATAL)


class UnstableWarning(UserWarning):
    """A simulation that is stepped outside of evs was unstable. Issued once per watch."""


def _unstable_joint(model: mujoco.MjModel, warning: int, info: int) -> str:
    """The joint and body that one of RESETTING is about."""
    if warning == Warnings.mjWARN_BADQPOS:
        return joint_place(model, joint_of_position(model, info))
    return joint_place(model, int(model.dof_jntid[info]))


class StabilityWatch:
    """Notices that MuJoCo found a bad state of data that is stepped outside of evs.

    MuJoCo resets such data by itself: they look as if they had been reset on purpose. Their count
    of warnings shows the difference, since a reset sets it to 0.
    """

    def __init__(self) -> None:
        self.count = 0
        """looks at which the simulation had become unstable"""
        self._t_s = math.nan
        self._numbers = np.zeros(len(RESETTING), np.int64)

    def forget(self) -> None:
        """Compare the next look with nothing: the data was reset, or is another one."""
        self._t_s = math.nan

    def look(self, model: mujoco.MjModel, data: mujoco.MjData) -> str | None:
        """Compare the data with the last look; a UnstableWarning for the first trouble.

        Args:
            model: Of the data.
            data: Stepped since the last look.

        Returns:
            When, what and where, where the simulation became unstable since then, else None.
        """
        numbers, t_s = data.warning.number[RESETTING], self._t_s
        # a reset begins to count again
        before = 0 if data.time <= t_s else self._numbers
        more = numbers > before
        first, self._t_s, self._numbers = math.isnan(t_s), data.time, numbers.copy()
        if first or not more.any():
            return None
        self.count += 1
        warning = int(RESETTING[more.argmax()])
        info = int(data.warning[warning].lastinfo)
        text = (
            f"unstable after t = {t_s:.6f} s: {FATAL[warning]} at "
            f"{_unstable_joint(model, warning, info)}"
        )
        if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_AUTORESET):
            text += "; MuJoCo has reset the data by itself"
        if self.count == 1:
            warnings.warn(text, UnstableWarning, stacklevel=3)
        return text


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
        self.data = new_data(model)
        self._before = np.zeros(mujoco.mj_stateSize(model, STATE))
        # MuJoCo's own memory, not a copy
        self._warnings = self.data.warning.number
        self.reset(keyframe)

    def part(self) -> mujoco.MjModel:
        """Go on with a copy of the model, in the same state; the copy."""
        saved, model = save_physics(self.model, self.data), copy.copy(self.model)
        self.model, self.data = model, new_data(model)
        put_physics(model, self.data, saved)
        self._warnings = self.data.warning.number
        return model

    def reset(
        self, keyframe: int = -1, start: Callable[[mujoco.MjData], None] | None = None
    ) -> None:
        """Go back to the beginning.

        Args:
            keyframe: Id of the keyframe to start from; -1: qpos0.
            start: Puts the data into another state.
        """
        model = self.model
        mujoco.mj_resetData(model, self.data)
        if keyframe >= 0:
            mujoco.mj_resetDataKeyframe(model, self.data, keyframe)
        if start is not None:
            start(self.data)
        self.data.time = 0.0
        # poses to read before the first step; they follow from qpos and change no state
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)
        mujoco.mj_camlight(model, self.data)
        self.tick = 0

    @contextmanager
    def unchanged_on_error(self) -> Iterator[None]:
        """Go back to the state of now if the block raises. The model must then be as it is now."""
        before = self.save()
        try:
            yield
        except BaseException:
            now = self.save()
            if any(now[name].tobytes() != array.tobytes() for name, array in before.items()):
                self.prepare_restore(before)()
            raise

    @property
    def t_us(self) -> int:
        """Simulated time, us: ticks times their length."""
        return self.tick * self.substeps.tick_us

    @property
    def state(self) -> F64:
        """(n,) everything that the next tick follows from, as mjSTATE_INTEGRATION; a copy."""
        return state_of(self.model, self.data)

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that `prepare_restore` takes back."""
        return {**save_physics(self.model, self.data), "tick": np.array(self.tick, np.int64)}

    def prepare_restore(self, saved: Arrays) -> Commit:
        """Checks what `save` gave; the commit puts it in place. Raises EvsError."""
        check_physics(self.model, self.data, saved)
        tick = saved.get("tick")
        if tick is None or tick.dtype != np.int64 or tick.shape or not 0 <= tick <= MAX_TICKS:
            raise EvsError("saved state is damaged: the number of ticks is invalid; save it again")
        number = int(tick)

        def commit() -> None:
            put_physics(self.model, self.data, saved)
            self.tick = number

        return commit

    def take(self, state: F64, tick: int) -> None:
        """Be in a state, as in `state`, after so many ticks. What follows is not computed."""
        mujoco.mj_setState(self.model, self.data, state, STATE)
        self.tick = tick

    def update(self) -> None:
        """Compute what follows from the state, for whoever looks at the data."""
        mujoco.mj_getState(self.model, self.data, self._before, STATE)
        self._warnings[_FATAL] = SILENT
        with suppress(mujoco.FatalError):
            mujoco.mj_forward(self.model, self.data)
        # and whatever forward has moved on
        mujoco.mj_setState(self.model, self.data, self._before, STATE)

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
        if warning in RESETTING:
            return _unstable_joint(model, warning, info)
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


# Libraries step MuJoCo by mujoco.mj_step and mj_step2, often several times in one call. From the
# first use of `watching` these names are functions that call MuJoCo's and then whoever watches the
# data; other data pass through.
_watchers: dict[int, list[Callable[[], None]]] = {}
"""id of a MjData -> called after each of its steps, in this order"""

_step, _step2 = mujoco.mj_step, mujoco.mj_step2


def mj_step(m: MjModel, d: MjData, nstep: int = 1) -> None:
    """MuJoCo's mj_step, which tells who watches the data."""
    watchers = _watchers.get(id(d))
    if watchers is None:
        _step(m, d, nstep)
        return
    for _ in range(nstep):
        _step(m, d)
        for watcher in watchers:
            watcher()


def mj_step2(m: MjModel, d: MjData) -> None:
    """MuJoCo's mj_step2, which tells who watches the data."""
    _step2(m, d)
    for watcher in _watchers.get(id(d), ()):
        watcher()


@contextmanager
def watching(data: MjData, watcher: Callable[[], None]) -> Iterator[None]:
    """Call `watcher` after each physics step of the data, while this is open. It may be nested."""
    mujoco.mj_step, mujoco.mj_step2 = mj_step, mj_step2
    watchers = _watchers.setdefault(id(data), [])
    watchers.append(watcher)
    try:
        yield
    finally:
        watchers.remove(watcher)
        if not watchers:
            del _watchers[id(data)]
