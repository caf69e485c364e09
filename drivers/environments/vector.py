"""make_vec: many environments in one process, whose observations are events."""

from __future__ import annotations

from typing import Any

from evs.emulator.world import Scene


def make_vec(scene: Scene, num_envs: int = 1, **options: Any) -> Any:
    """Make a Gymnasium vector environment of many worlds, which one process steps together.

        envs = evs.make_vec("robot.xml", 64, cameras="wrist", observation="voxel_grid")
        envs = evs.make_vec("evs/CartPole-v0", 64)     # a registered one, other options allowed

    Args:
        scene: A registered name (evs/CartPole-v0, ...), or a scene as of LoopEnv.
        num_envs: How many environments.
        **options: See `evs.drivers.gym.LoopVectorEnv`: cameras, observation, reward, ...

    Returns:
        A gymnasium.vector.VectorEnv.

    Raises:
        EvsError: Gymnasium is not installed (extra gym), or an option is not possible.
    """
    from evs.drivers.gym.library import gymnasium
    from evs.drivers.gym.loop_vector_env import LoopVectorEnv
    from evs.drivers.gym.registration import ENVIRONMENTS

    if isinstance(scene, str) and scene in ENVIRONMENTS:
        mode = "vector_entry_point"
        return gymnasium.make_vec(scene, num_envs=num_envs, vectorization_mode=mode, **options)
    return LoopVectorEnv(scene, num_envs=num_envs, **options)
