"""Gymnasium environments whose observations are events.

    import gymnasium
    import evs.drivers.gym                                # registers evs/...
    env = gymnasium.make("evs/CartPole-v0", observation="voxel_grid")

or in one call: `gymnasium.make("evs.drivers.gym:evs/CartPole-v0")`.
"""

from evs.drivers.gym.loop_env import LoopEnv
from evs.drivers.gym.loop_vector_env import LoopVectorEnv
from evs.drivers.gym.registration import ENVIRONMENTS, register_all
from evs.drivers.gym.task import TaskSpec

__all__ = ["ENVIRONMENTS", "LoopEnv", "LoopVectorEnv", "TaskSpec", "register_all"]
