"""Rewards of the steps: by weights of the model's sensors, or by a function."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError, unknown

Sensors = dict[str, npt.NDArray[np.float64]]
"""name of a <sensor> of the model -> its values"""

Reward = Mapping[str, float] | Callable[[Sensors, npt.NDArray[np.float64]], float]
"""name of a <sensor> -> weight of its length (absolute value, of one number); or a function of all
named sensors and the control."""


def check_reward(reward: Reward, sensors: tuple[str, ...]) -> Reward:
    """Check a reward.

    Returns:
        The reward.

    Raises:
        EvsError: A sensor does not exist, or a weight is not a finite number.
    """
    if callable(reward):
        return reward
    if not isinstance(reward, Mapping):
        raise EvsError(f"reward is {reward!r}; give {{sensor: weight}}, or a function")
    for name, weight in reward.items():
        if name not in sensors:
            raise unknown("sensor", str(name), sensors)
        if not (isinstance(weight, int | float | np.number) and math.isfinite(weight)):
            raise EvsError(f"reward['{name}'] is {weight!r}; give its weight, a number")
    return reward


def reward_of(reward: Reward, sensors: Sensors, control: npt.NDArray[np.float64]) -> float:
    """The reward of a step, without the bonus for being alive."""
    if callable(reward):
        return float(reward(sensors, control))
    return float(sum(weight * np.linalg.norm(sensors[name]) for name, weight in reward.items()))
