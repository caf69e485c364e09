"""Where an environment keeps MuJoCo's model and data."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from evs.emulator.world import MjData, MjModel
from evs.msgs import EvsError

PLACES: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    "env.model, env.data (Gymnasium, Gymnasium-Robotics, Metaworld)": lambda env: (
        env.model,
        env.data,
    ),
    "env.sim.model, env.sim.data (robosuite)": lambda env: (
        env.sim.model._model,
        env.sim.data._data,
    ),
    "env.physics.model, env.physics.data (dm_control)": lambda env: (
        env.physics.model.ptr,
        env.physics.data.ptr,
    ),
}
"""where -> how to get there"""


def is_gymnasium(env: object) -> bool:
    """Is it a Gymnasium environment? Imports nothing."""
    gymnasium = sys.modules.get("gymnasium")
    return gymnasium is not None and isinstance(env, gymnasium.Env)


def holds_environments(env: object) -> bool:
    """Is it a Gymnasium vector environment whose environments are in this process?"""
    vector = sys.modules.get("gymnasium.vector")
    if vector is None or not isinstance(env, vector.VectorEnv):
        return False
    return isinstance(getattr(env.unwrapped, "envs", None), list)


def find_physics(env: Any) -> tuple[MjModel, MjData]:
    """The model and the data that an environment steps now.

    Raises:
        EvsError: It has none, or steps several worlds.
    """
    inner = getattr(env, "unwrapped", env)
    for place in PLACES.values():
        try:
            model, data = place(inner)
        except AttributeError:
            continue
        if isinstance(model, MjModel) and isinstance(data, MjData):
            return model, data
    kind = f"{type(inner).__module__}.{type(inner).__qualname__}"
    if hasattr(inner, "num_envs"):
        raise EvsError(
            f"{kind} is a vector of environments: wrap each of them, e.g. "
            "gymnasium.make_vec(..., wrappers=[evs.wrap]), and read get_attr('events')"
        )
    raise EvsError(
        f"{kind} has no mujoco.MjModel and MjData at {', '.join(PLACES)}: use evs.EventCamera with "
        "those that you have"
    )
