"""Run a program of CleanRL, its file unchanged, with evs.make_vec in place of SyncVectorEnv.

    python .ci/cleanrl.py FILE [OPTION ...]

FILE makes its environments by gymnasium.vector.SyncVectorEnv; only their number counts. Options
are those of FILE. It is written for Gymnasium 0.29, whose infos these have. Ends with the mean
returns of the first and the last episodes, and fails where the last are not better.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import flatten_space
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import ClipAction, NormalizeReward, RecordEpisodeStatistics

import evs

EPISODES = 20
RETURNS: list[float] = []
"""of all episodes"""


class FlatEnvs(gymnasium.vector.VectorWrapper):
    """Flat observations, and infos as Gymnasium 0.29 had them.

    Gymnasium's own FlattenObservation refuses SameStep, which CleanRL expects.
    """

    def __init__(self, env: Any) -> None:
        """Put the wrapper around environments that record their episodes."""
        super().__init__(env)
        self.single_observation_space = flatten_space(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        """Begin episodes."""
        seen, infos = super().reset(seed=seed, options=options)
        return seen.reshape(self.num_envs, -1), infos

    def step(self, actions: Any) -> Any:
        """Act; final_info is a list with a dict for each environment whose episode ended."""
        seen, *found, infos = super().step(actions)
        if "episode" in infos:
            episode, ended = infos.pop("episode"), infos["_episode"]
            infos["final_info"] = [
                {"episode": {key: episode[key][i : i + 1] for key in "rlt"}} if over else None
                for i, over in enumerate(ended)
            ]
            RETURNS.extend(episode["r"][ended].tolist())
        return seen.reshape(self.num_envs, -1), *found, infos


def environments(made: Sequence[Any]) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """As many cart poles in one process, in the wrappers of CleanRL that they need."""
    envs = evs.make_vec(
        "evs/CartPole-v0",
        len(made),
        observation="voxel_grid",
        size=(24, 18),
        autoreset_mode="SameStep",
    )
    return FlatEnvs(NormalizeReward(ClipAction(RecordEpisodeStatistics(envs)), gamma=0.99))


def main() -> None:
    """Run the program."""
    gymnasium.vector.SyncVectorEnv = environments
    sys.argv = sys.argv[1:]
    runpy.run_path(sys.argv[0], run_name="__main__")
    first, last = np.mean(RETURNS[:EPISODES]), np.mean(RETURNS[-EPISODES:])
    print(f"mean return of {EPISODES} episodes: {first:.0f} at first, {last:.0f} at last")
    if not last > first:
        sys.exit("it has not learnt")


if __name__ == "__main__":
    main()
