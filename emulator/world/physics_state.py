"""Physics as named arrays: mjSTATE_INTEGRATION, and who sleeps, which is no part of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.world.compat import SLEEP
from evs.msgs import EvsError

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
