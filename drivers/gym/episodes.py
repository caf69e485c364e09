"""How an episode begins, and what its steps are worth: by names of the model, or by functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.world import MjData, MjModel
from evs.msgs import EvsError, unknown

Start = Mapping[str, tuple[float, float]] | Callable[[np.random.Generator, MjData], None]
"""name of a joint with one coordinate -> range of its position, drawn evenly at each reset; or a
function that puts the data somewhere."""

Sensors = dict[str, npt.NDArray[np.float64]]
"""name of a <sensor> of the model -> what it says"""

Reward = Mapping[str, float] | Callable[[Sensors, npt.NDArray[np.float64]], float]
"""name of a <sensor> -> weight of its length (absolute value, of one number); or a function of all
named sensors and the control."""


def check_start(model: MjModel, start: Start) -> Start:
    """`start` if every joint exists and every range is one; else EvsError."""
    if callable(start):
        return start
    slides_and_hinges = (2, 3)
    known = {
        model.joint(index).name: int(model.jnt_type[index]) in slides_and_hinges
        for index in range(model.njnt)
    }
    for name, limits in start.items():
        if name not in known:
            raise unknown("joint", name, (one for one in known if one))
        if not known[name]:
            raise EvsError(f"joint '{name}' has more than one coordinate: give start= a function")
        if not _is_range(limits):
            raise EvsError(f"start['{name}'] is {limits!r}; give (low, high), such as (-0.1, 0.1)")
    return start


def begin(start: Start, random: np.random.Generator, data: MjData) -> None:
    """Put the data where an episode begins. Draws in the order of the names given."""
    if callable(start):
        start(random, data)
        return
    for name, (low, high) in start.items():
        data.joint(name).qpos[0] = random.uniform(low, high)


def check_reward(reward: Reward, sensors: tuple[str, ...]) -> Reward:
    """`reward` if every sensor exists and every weight is a number; else EvsError."""
    if callable(reward):
        return reward
    for name, weight in reward.items():
        if name not in sensors:
            raise unknown("sensor", name, sensors)
        if not _is_number(weight):
            raise EvsError(f"reward['{name}'] is {weight!r}; give its weight, a number")
    return reward


def reward_of(reward: Reward, sensors: Sensors, control: npt.NDArray[np.float64]) -> float:
    """What a step was worth, without the bonus for being alive."""
    if callable(reward):
        return float(reward(sensors, control))
    return float(sum(weight * np.linalg.norm(sensors[name]) for name, weight in reward.items()))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and math.isfinite(value)


def _is_range(value: Any) -> bool:
    try:
        low, high = value
    except (TypeError, ValueError):
        return False
    return _is_number(low) and _is_number(high) and low <= high
